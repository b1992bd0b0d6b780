"""Write ``tests/fixtures``: small meshes by Blender, trimesh and OpenUSD, as these tools write them.

``python tests/make_fixtures.py``, with bpy 5.0.1, trimesh 5.2.0, usd-core 26.11; nothing of this project is used. The
files in ``tests/fixtures/by_hand`` are written by hand.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import trimesh
from pxr import Gf, Usd, UsdGeom

HERE = Path(__file__).parent / "fixtures"
AROUND, ROWS = 12, 4


def skirt() -> tuple[np.ndarray, list[list[int]]]:
    """Quads, 12 around and 3 down, radius 0.2 m at z = 1 m to 0.3 m at z = 0.6 m."""
    points, quads = [], []
    for row in range(ROWS):
        share = row / (ROWS - 1)
        for k in range(AROUND):
            angle, radius = 2 * math.pi * k / AROUND, 0.2 + 0.1 * share
            points.append([radius * math.cos(angle), radius * math.sin(angle), 1.0 - 0.4 * share])
    for row in range(ROWS - 1):
        for k in range(AROUND):
            a, b = row * AROUND + k, row * AROUND + (k + 1) % AROUND
            quads.append([a, a + AROUND, b + AROUND, b])
    return np.array(points), quads


def new(name: str, points: np.ndarray, faces: list[list[int]], materials: int = 0, uv: bool = True):
    """A mesh object; its faces have ``materials`` in turn, and a seam of the texture runs down at k = 0."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points.tolist(), [], faces)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    if uv:
        layer = mesh.uv_layers.new(name="map")
        for polygon in mesh.polygons:
            for loop, vertex in zip(polygon.loop_indices, polygon.vertices, strict=True):
                u = vertex % AROUND / AROUND
                last = polygon.index % AROUND == AROUND - 1
                layer.data[loop].uv = (u if u or not last else 1.0, 1.0 - vertex // AROUND / (ROWS - 1))
    for number in range(materials):
        mesh.materials.append(bpy.data.materials.new(f"cloth {number}"))
    for polygon in mesh.polygons:
        polygon.material_index = polygon.index % max(materials, 1)
    mesh.update()
    return thing


def empty(fps: int = 24, last: int = 1) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = fps, 1, last


def garments(folder: Path) -> None:
    empty()
    new("skirt", *skirt(), materials=2)
    bpy.ops.wm.obj_export(filepath=f"{folder}/skirt.obj")
    bpy.ops.wm.ply_export(filepath=f"{folder}/skirt.ply", export_uv=True)
    bpy.ops.wm.stl_export(filepath=f"{folder}/skirt.stl")
    bpy.ops.wm.alembic_export(filepath=f"{folder}/skirt.abc", start=1, end=1, as_background_job=False)
    bpy.ops.wm.usd_export(filepath=f"{folder}/skirt.usdc", export_materials=True)
    bpy.ops.export_scene.fbx(filepath=f"{folder}/skirt.fbx")
    bpy.ops.export_scene.gltf(filepath=f"{folder}/skirt.glb")
    bpy.ops.export_scene.gltf(filepath=f"{folder}/skirt.gltf", export_format="GLTF_SEPARATE")
    bpy.ops.export_scene.gltf(filepath=f"{folder}/skirt_draco.glb", export_draco_mesh_compression_enable=True)
    bpy.context.scene.objects["skirt"].scale = (-1, 1, 1)
    bpy.ops.export_scene.gltf(filepath=f"{folder}/skirt_mirrored.glb")
    bpy.ops.wm.alembic_export(filepath=f"{folder}/skirt_mirrored.abc", start=1, end=1, as_background_job=False)
    empty()
    new("skirt", *skirt(), uv=False)
    button = np.array([[0.31, 0.0, 0.7], [0.31, 0.02, 0.7], [0.31, 0.02, 0.72], [0.31, 0.0, 0.72]])
    for number in range(2):
        new(f"button {number}", button + [0.0, 0.0, 0.1 * number], [[0, 1, 2, 3]], uv=False)
    bpy.ops.wm.obj_export(filepath=f"{folder}/buttons.obj", export_materials=False)
    empty()
    bpy.ops.mesh.primitive_cylinder_add(vertices=7, radius=0.3, depth=1.0)
    bpy.ops.wm.ply_export(filepath=f"{folder}/ngons.ply", export_normals=False)


def bodies(folder: Path) -> None:
    """A cylinder with polygons for caps, bent by an armature as Mixamo has it: centimetres, y up, scaled by 0.01."""
    empty(24, 9)
    bpy.ops.mesh.primitive_cylinder_add(vertices=8, radius=16, depth=170, location=(0, 0, 85))
    body = bpy.context.object
    bpy.ops.object.transform_apply(location=True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=2)
    bpy.ops.object.mode_set(mode="OBJECT")
    rig = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    hips, spine = rig.data.edit_bones.new("hips"), rig.data.edit_bones.new("spine")
    hips.head, hips.tail, spine.head, spine.tail = (0, 0, 0), (0, 85, 0), (0, 85, 0), (0, 170, 0)
    spine.parent = hips
    bpy.ops.object.mode_set(mode="OBJECT")
    for vertex in body.data.vertices:
        x, y, z = vertex.co
        vertex.co = (x, z, -y)
    body.parent, rig.rotation_euler, rig.scale = rig, (math.pi / 2, 0, 0), (0.01,) * 3
    for name, low in (("hips", True), ("spine", False)):
        group = body.vertex_groups.new(name=name)
        group.add([v.index for v in body.data.vertices if (v.co.y <= 85) == low], 1.0, "REPLACE")
    body.modifiers.new("rig", "ARMATURE").object = rig
    bone = rig.pose.bones["spine"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), (5, 0.5), (9, 0.1)):
        bone.rotation_euler = (angle, 0, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)
    moments = []
    for frame in range(1, 10):
        bpy.context.scene.frame_set(frame)
        bent = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
        moments.append([list(bent.matrix_world @ vertex.co) for vertex in bent.to_mesh().vertices])
    np.savez_compressed(f"{folder}/bent_expected.npz", positions=np.array(moments, np.float32))
    bpy.ops.export_scene.gltf(filepath=f"{folder}/bent.glb", export_frame_range=True)
    whole = {"start": 1, "end": 9, "uvs": False, "normals": False, "as_background_job": False}
    bpy.ops.wm.alembic_export(filepath=f"{folder}/bent.abc", **whole)
    bpy.ops.wm.usd_export(filepath=f"{folder}/bent.usdc", export_animation=True)
    bpy.ops.export_scene.fbx(filepath=f"{folder}/bent.fbx", bake_anim_use_nla_strips=False)


def clips(folder: Path) -> None:
    """A cube with two animations: it walks along x, or jumps along z."""
    empty(24, 5)
    bpy.ops.mesh.primitive_cube_add(size=1)
    cube = bpy.context.object
    cube.animation_data_create()
    for name, way in (("walk", (1, 0, 0)), ("jump", (0, 0, 1))):
        action = bpy.data.actions.new(name)
        cube.animation_data.action = action
        for frame, share in ((1, 0.0), (5, 1.0)):
            cube.location = [share * part for part in way]
            cube.keyframe_insert("location", frame=frame)
        track = cube.animation_data.nla_tracks.new()
        track.name = name
        track.strips.new(name, 1, action)
        cube.animation_data.action = None
    bpy.ops.export_scene.gltf(filepath=f"{folder}/clips.glb")
    bpy.ops.export_scene.fbx(filepath=f"{folder}/clips.fbx", bake_anim_use_all_actions=False)


def outfits(folder: Path) -> None:
    """A skirt of two materials, a floor, and a body in a group that rises by 1 cm a frame, in one file."""
    empty(24, 3)
    new("Skirt", *skirt(), materials=2)
    new("Floor", np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), [[0, 1, 2, 3]], uv=False)
    bpy.ops.mesh.primitive_cylinder_add(vertices=8, radius=0.15, depth=1.6, location=(0, 0, 0.85))
    body, group = bpy.context.object, bpy.data.objects.new("Person", None)
    body.name, body.data.name, body.parent = "Body", "Cylinder", group
    bpy.context.scene.collection.objects.link(group)
    for frame in (1, 3):
        group.location.z = 0.01 * (frame - 1)
        group.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)
    whole = {"start": 1, "end": 3, "uvs": False, "normals": False, "as_background_job": False}
    bpy.ops.wm.obj_export(filepath=f"{folder}/outfit.obj", export_materials=False, export_normals=False)
    bpy.ops.wm.alembic_export(filepath=f"{folder}/outfit.abc", **whole)
    bpy.ops.wm.alembic_export(filepath=f"{folder}/outfit_cm.abc", global_scale=100, **whole)  # as Maya has it
    bpy.ops.wm.usd_export(filepath=f"{folder}/outfit.usdc", export_animation=True, export_materials=False)
    bpy.ops.export_scene.fbx(filepath=f"{folder}/outfit.fbx", bake_anim_use_nla_strips=False)
    bpy.ops.export_scene.gltf(filepath=f"{folder}/outfit.glb", export_frame_range=True)


def by_trimesh(folder: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    arm = trimesh.creation.icosphere(subdivisions=1, radius=0.15)
    arm.apply_translation([0.35, 0.0, 0.0])
    for mesh, name in ((ball.copy(), "ball_inside_out.stl"), (ball.copy(), "ball_inside_out.glb")):
        mesh.invert()
        mesh.export(folder / name)
    wrong = arm.copy()
    wrong.invert()
    trimesh.util.concatenate([ball, wrong]).export(folder / "ball_arm.ply")
    mixed = ball.copy()
    mixed.faces = np.where(np.arange(len(ball.faces))[:, None] % 3 == 0, ball.faces[:, ::-1], ball.faces)
    mixed.export(folder / "ball_mixed.obj")
    opened = ball.submesh([np.flatnonzero(ball.triangles_center[:, 2] > -0.1)], append=True)
    opened.invert()
    opened.export(folder / "ball_open.ply")
    trimesh.Scene({"ball": ball, "arm": arm}).export(folder / "two_parts.glb")
    trimesh.PointCloud(ball.vertices).export(folder / "points.ply")


def by_usd(folder: Path) -> None:
    """A sheet in centimetres with y up and 30 time codes per second that rises by 1 cm a frame from frame 10 on."""
    stage = Usd.Stage.CreateNew(f"{folder}/sheet.usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(30)
    stage.SetStartTimeCode(10)
    stage.SetEndTimeCode(13)
    mesh = UsdGeom.Mesh.Define(stage, "/sheet")
    points = [(40.0 * i, 100.0, 30.0 * j) for j in range(3) for i in range(3)]
    for frame in range(4):
        raised = [Gf.Vec3f(x, y + frame, z) for x, y, z in points]
        mesh.GetPointsAttr().Set(raised, 10 + frame)
    quads = [[j * 3 + i, j * 3 + 3 + i, j * 3 + 4 + i, j * 3 + 1 + i] for j in range(2) for i in range(2)]
    mesh.CreateFaceVertexCountsAttr([4] * 4)
    mesh.CreateFaceVertexIndicesAttr(np.ravel(quads).tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    stage.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(f"{folder}/groups.usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for number, name in enumerate(("Shirt/mesh", "Person/mesh", "Person/hair")):  # meshes of one name in two groups
        UsdGeom.Xform.Define(stage, f"/World/{name.split('/')[0]}")
        mesh = UsdGeom.Mesh.Define(stage, f"/World/{name}")
        mesh.CreatePointsAttr([Gf.Vec3f(number, 0, 0), Gf.Vec3f(number + 1, 0, 0), Gf.Vec3f(number, 1, 0)])
        mesh.CreateFaceVertexCountsAttr([3])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.GetRootLayer().Save()


if __name__ == "__main__":
    for name, write in (("trimesh", by_trimesh), ("usd", by_usd)):
        (HERE / name).mkdir(parents=True, exist_ok=True)
        write(HERE / name)
    (HERE / "blender").mkdir(parents=True, exist_ok=True)
    for write in (garments, bodies, clips, outfits):
        write(HERE / "blender")
