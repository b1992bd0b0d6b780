"""A recorded sequence as a scene: a simulator starts from two recorded frames and goes on by itself."""

from __future__ import annotations

from drape.data.hdf5 import GarmentFile
from drape.data.sequence import GarmentSequence
from drape.data.trajectories import open_trajectories
from drape.errors import DrapeError
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State

START = 1
"""The recorded frame at which the scene begins: the first with a velocity."""


def garment_scene(path: str, sequence: str, frames: int | None = None, fabric: str | None = None) -> Scene:
    """The sequence called ``sequence`` of the garments at ``path``: see :func:`recorded_scene`.

    ``fabric`` is that of the energies which are to animate it.

    Raises:
        DrapeError: no such file or sequence, a sequence of another fabric, or see :func:`recorded_scene`.
    """
    recorded = GarmentFile(path).sequence(sequence)
    if fabric is not None and recorded.fabric != fabric:
        raise DrapeError(
            f"{path}: sequences/{sequence}: found a garment of {recorded.fabric or 'no fabric'}; expected one of "
            f"{fabric}, as the energies are; choose fabric={recorded.fabric}, or another sequence"
        )
    return recorded_scene(recorded, frames)


def held_out(path: str, fabric: str, sequence: int, frames: int) -> Scene:
    """Test sequence number ``sequence`` (0, 1, ...) of ``fabric``, without a body: see :func:`recorded_scene`.

    Raises:
        DrapeError: no such file, fabric or sequence, or see :func:`recorded_scene`.
    """
    file = open_trajectories(path)
    if fabric not in file.fabrics:
        raise DrapeError(f"{path}: found no fabric {fabric!r}; expected one of {', '.join(file.fabrics)}")
    of_fabric = [each for each in file.sequences if (each.split, each.fabric) == ("test", fabric)]
    if not 0 <= sequence < len(of_fabric):
        raise DrapeError(
            f"{path}: scene.sequence: found {sequence}; expected 0..{len(of_fabric) - 1}, as the test split has "
            f"{len(of_fabric)} sequences of {fabric}"
        )
    return recorded_scene(of_fabric[sequence], frames, name=f"held_out_{fabric}_{sequence}")


def recorded_scene(
    sequence: GarmentSequence, frames: int | None = None, areal_density: float | None = None, name: str | None = None
) -> Scene:
    """Cloth, fabric, masses, gravity and friction as recorded; body and pinned vertices move as recorded.

    The scene begins at the recorded frame 1 with ``v = (x¹ - x⁰) / dt``; its frame k is the recorded frame k + 1, and
    the recorded frames are its ``reference``. ``frames`` to simulate; None for all that are recorded.
    ``areal_density`` [kg/m²] instead of the recorded masses, for a law of a fabric that weighs otherwise.

    Raises:
        DrapeError: the garment was not recorded, or fewer frames than asked for.
    """
    file, frames = sequence.file, scene_frames(sequence, frames)
    mass = sequence.mass if areal_density is None else vertex_masses(sequence.mesh, {"areal_density": areal_density})
    recorded = sequence.positions[: START + frames + 1]
    body, pinned = sequence.window(START, frames + 1).body_positions, sequence.pinned
    pins = None
    if len(pinned):  # those of a sheet stand still
        pins = Pins.fixed(pinned, recorded[START]) if body is None else Pins(pinned, recorded[START:, pinned])
    return Scene(
        name=name or f"{sequence.name}_{sequence.kind}",
        mesh=sequence.mesh,
        initial=State(recorded[START], (recorded[START] - recorded[START - 1]) / file.dt),
        material=Material.from_settings(sequence.fabric, file.materials[sequence.fabric]),
        mass=mass,
        gravity=sequence.gravity,
        dt=file.dt,
        frames=frames,
        pins=pins,
        obstacle=None if body is None else Obstacle(sequence.body_faces, body),
        friction=None if body is None else sequence.friction or None,
        reference=recorded[START:],
    )


def scene_frames(sequence: GarmentSequence, frames: int | None = None) -> int:
    """Frames that a scene of the sequence simulates: ``frames``, or None for all that are recorded after its start.

    Raises:
        DrapeError: the garment was not recorded, or fewer frames than asked for.
    """
    where = f"{sequence.file.path}: sequences/{sequence.name}"
    if not sequence.is_recorded:
        raise DrapeError(
            f"{where}: found the motion of a body without recorded positions of a garment; expected some to start from "
            "and to compare with; choose a data set that has them"
        )
    last = sequence.num_frames - START - 1
    frames = last if frames is None else frames
    if not 1 <= frames <= last:
        raise DrapeError(
            f"{where}: frames: found {frames}; expected 1..{last}, as {sequence.num_frames} are recorded and the scene "
            f"begins at frame {START}"
        )
    return frames
