"""Any file or folder of meshes as one :class:`MeshFile`."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from plyfile import PlyData

from drape.errors import DrapeError
from drape.reading.arrays_file import read_arrays
from drape.reading.blender_file import read_with_blender
from drape.reading.mesh_record import MeshFile, Polygons
from drape.reading.obj_file import read_obj
from drape.reading.objects import of_object

GLTF = (".glb", ".gltf")
ARRAYS = (".npz", ".h5", ".hdf5")
BLENDER = (".abc", ".usd", ".usda", ".usdc", ".usdz", ".fbx")
MESHES = (".obj", ".ply", ".stl", *GLTF)
KINDS = (*MESHES, *BLENDER, *ARRAYS)
NOT_MESHES = {
    ".bvh": "a BVH file holds a skeleton without a skin: skin a mesh with it in Blender, and export that as GLB",
    ".blend": "export its meshes from Blender as Alembic (animated) or OBJ",
    ".dae": "Blender 5 reads no Collada: convert it to GLB or FBX",
    ".zprj": "export from CLO or Marvelous Designer as OBJ or Alembic",
    ".pkl": "pickles run code when they are opened: store arrays faces, positions and fps as npz",
    ".off": "convert it to PLY or OBJ, as MeshLab does",
    ".3mf": "it holds parts to print, in millimetres: export it from Blender or a slicer as STL or OBJ, in metres",
    ".pc2": "a point cache has no faces: export the mesh as Alembic or as npz with faces, positions and fps",
    ".mdd": "a point cache has no faces: export the mesh as Alembic or as npz with faces, positions and fps",
}
"""Files that people try, and the way out."""


def read_file(
    path: Path | str,
    *,
    animated: bool = False,
    dt: float | None = None,
    frames: int | None = None,
    clip: str | None = None,
    wanted: str | None = None,
) -> MeshFile:
    """The meshes of a file, or of a folder with one file a frame in natural order (``body_2`` before ``body_10``).

    OBJ, PLY and STL hold one frame; npz and HDF5 arrays; the rest is opened by Blender, glTF only where it has to be
    (an ``animated`` one, with skins, or compressed). What Blender opens is sampled every ``dt`` [s], None for the
    rate of the file, in at most ``frames`` + 1 frames; only its first frame if it is not ``animated``. ``clip``: which
    animation of the file is played, if it has several. ``wanted``: the object, or the group of objects, that is read of
    a file of several; None for all of them as one mesh.

    Raises:
        DrapeError: no such file, a kind that cannot be read with the way out, a file that is broken, no such object.
    """
    path = Path(path).expanduser()
    if path.is_dir():
        return _folder(path, wanted)
    if not path.exists():
        raise DrapeError(f"{path}: no such file or folder; give the path of a mesh ({', '.join(KINDS)})")
    kind = path.suffix.lower()
    if kind not in KINDS:
        hint = NOT_MESHES.get(kind)
        known = f"expected a folder of meshes or one of {', '.join(KINDS)}" if hint is None else hint
        raise DrapeError(f"{path}: found a file of kind {kind or 'nothing'!r}; {known}")
    if kind in ARRAYS:
        return of_object(read_arrays(path), wanted)
    if kind in BLENDER or (kind in GLTF and (animated or _needs_blender(path))):
        return read_with_blender(path, dt if animated else None, frames if animated else 0, clip, wanted)
    try:
        source = READERS[kind](path)
    except Exception as error:  # a parser may fail in any way
        raise DrapeError(
            f"{path}: cannot be read as {kind[1:].upper()} ({type(error).__name__}: {error}); export the mesh again"
        ) from error
    return of_object(source, wanted)


def natural_order(path: Path) -> list[tuple[int, int, str]]:
    """Sort key of file names: numbers by value, all else by letters."""
    parts = re.split(r"(\d+)", path.name)
    return [(1, int(part), part) if part.isdigit() else (0, 0, part) for part in parts if part]


def _folder(folder: Path, wanted: str | None) -> MeshFile:
    files = sorted((file for file in folder.iterdir() if file.suffix.lower() in MESHES), key=natural_order)
    if not files:
        raise DrapeError(f"{folder}: found no mesh in this folder; expected one file a frame ({', '.join(MESHES)})")
    first = read_file(files[0], wanted=wanted)
    moments = [first.positions]
    for file in files[1:]:
        other = read_file(file, wanted=wanted)
        if other.positions.shape != first.positions.shape or not other.polygons.same_as(first.polygons):
            counts = [(mesh.positions.shape[1], len(mesh.polygons.sizes)) for mesh in (other, first)]
            raise DrapeError(
                f"{file}: found {counts[0][0]} vertices and {counts[0][1]} faces that are not those of {files[0].name} "
                f"({counts[1][0]} and {counts[1][1]}); expected the same topology in every frame; export the body "
                "without changing its mesh"
            )
        moments.append(other.positions)
    number = re.findall(r"\d+", files[0].stem)
    return replace(first, path=folder, positions=np.concatenate(moments), first=int(number[-1]) if number else 0)


def _ply(path: Path) -> MeshFile:
    ply = PlyData.read(path)
    vertices = ply["vertex"].data
    positions = np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)[None]
    if "face" not in ply:
        return MeshFile(path, Polygons.of_faces(np.zeros((0, 3), np.int64)), positions)
    faces = ply["face"].data
    name = next(name for name in faces.dtype.names if name in ("vertex_indices", "vertex_index"))
    polygons = [np.asarray(face, np.int64) for face in faces[name]]
    corners = np.concatenate(polygons) if polygons else np.zeros(0, np.int64)
    uv = None
    for s, t in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        if s in vertices.dtype.names and t in vertices.dtype.names:
            uv = np.stack([vertices[s], vertices[t]], axis=1).astype(np.float64)[corners]
    sizes = np.array([len(face) for face in polygons], np.int64)
    return MeshFile(path, Polygons(corners, sizes), positions, uv=uv)


def _by_trimesh(path: Path) -> MeshFile:
    """STL and plain glTF: triangles only; +y is up in glTF and its unit is the metre."""
    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if not meshes:
        return MeshFile(path, Polygons.of_faces(np.zeros((0, 3), np.int64)), np.zeros((1, 0, 3)))
    begin = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, begin, strict=False)])
    uvs = [getattr(mesh.visual, "uv", None) for mesh in meshes]
    missing = [np.full((len(mesh.vertices), 2), np.nan) for mesh in meshes]
    uv = np.concatenate([lack if part is None else part for part, lack in zip(uvs, missing, strict=True)])
    uv = None if np.isnan(uv).all() else uv.astype(np.float64)[faces.reshape(-1)]
    names = [getattr(getattr(mesh.visual, "material", None), "name", None) for mesh in meshes]
    materials = tuple(dict.fromkeys(name for name in names if name))
    known = {name: number for number, name in enumerate(materials)}
    each = [np.full(len(mesh.faces), known.get(name, -1)) for mesh, name in zip(meshes, names, strict=True)]
    is_gltf = path.suffix.lower() in GLTF
    positions = np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float64)[None]
    return MeshFile(
        path, Polygons.of_faces(faces), positions, uv=uv, materials=materials,
        material=np.concatenate(each) if materials else None,
        unit=1.0 if is_gltf else None, up="y" if is_gltf else None, **_nodes(scene, meshes, path),
    )  # fmt: skip


def _nodes(scene: trimesh.Scene, meshes: list[trimesh.Trimesh], path: Path) -> dict:
    """The fields ``objects`` and ``object`` of glTF; trimesh makes nodes of its own for meshes of several materials."""
    named = {node.get("name") for node in _document(path).get("nodes", ())} if path.suffix.lower() in GLTF else set()
    above, each = scene.graph.transforms.parents, []
    objects: dict[tuple[str, ...], int] = {}
    for mesh in meshes:
        node = mesh.metadata["node"]
        names: list[str] = []
        while node in above:
            names[:0] = [node] if node in named else []
            node = above[node]
        each += [objects.setdefault(tuple(names), len(objects))] * len(mesh.faces)
    return {"objects": tuple(objects), "object": np.array(each, np.int64)}


def _needs_blender(path: Path) -> bool:
    """Whether trimesh would read zeros (compressed) or the wrong place (skins)."""
    return bool({"skins", "extensionsRequired"} & set(_document(path)))


def _document(path: Path) -> dict:
    """The JSON of a glTF file; empty where it is broken, as whoever reads the meshes says what is wrong."""
    try:
        content = path.read_bytes()
        if path.suffix.lower() == ".glb":
            content = content[20 : 20 + struct.unpack("<I", content[12:16])[0]]
        return json.loads(content)
    except (ValueError, struct.error):
        return {}


READERS: dict[str, Callable[[Path], MeshFile]] = {
    ".obj": read_obj, ".ply": _ply, ".stl": _by_trimesh, ".glb": _by_trimesh, ".gltf": _by_trimesh,
}  # fmt: skip
