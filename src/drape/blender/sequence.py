"""One sequence of a data set: random start, simulation, acceptance, storage. Does not import bpy."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drape.blender.initial_state import random_state
from drape.data.motion import edge_strain, external_energy_per_mass
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh

Simulate = Callable[..., np.ndarray]
"""``drape.blender.cloth.simulate``, handed in so that everything here can be tested without Blender."""


def cloth_mesh(data: Mapping) -> tuple[ClothMesh, Int[np.ndarray, " pinned"]]:
    """The square sheet of a data set, and its pinned vertices: the two top corners."""
    mesh = square_grid(data["size"], data["resolution"], data["pattern"])
    return mesh, np.array([0, data["resolution"] - 1])


def fabric_of(index: int, fabrics: int) -> int:
    """Sequence i is made of fabric i mod n, so that the fabrics come in equal parts in both splits."""
    return index % fabrics


def split_of(index: int, counts: Mapping[str, int]) -> int:
    """The first ``counts.train`` sequences are the training split (0), the others the test split (1)."""
    return int(index >= counts["train"])


def make_sequence(index: int, plan: Mapping, simulate: Simulate) -> tuple[Float[np.ndarray, "frames vertices 3"], int]:
    """Positions [m] of sequence ``index`` of a plan, and the number of attempts that it took.

    Attempt k = 1, 2, ... draws from ``numpy.random.default_rng([seed, index, k])`` and from nothing else, so the
    result depends neither on other sequences nor on who computes it. The first attempt without a
    :func:`reason_to_reject` is taken.

    Raises:
        DrapeError: all ``data.reject.attempts`` attempts were rejected.
    """
    data, settings = plan["data"], list(plan["settings"].values())
    mesh, pinned = cloth_mesh(data)
    gravity = np.array([0.0, 0.0, -float(data["gravity"])])
    fabric = settings[fabric_of(index, len(settings))]
    for attempt in range(1, data["reject"]["attempts"] + 1):
        rng = np.random.default_rng([data["seed"], index, attempt])
        state = random_state(mesh.rest_positions, pinned, data["start"], fabric["bending_stiffness"], rng)
        acceleration = np.tile(gravity, (state.preroll + data["frames"] - 1, 1))
        acceleration[: state.preroll] += state.push
        frames = simulate(mesh.rest_positions, mesh.faces, pinned, fabric, state.positions, acceleration, data["fps"])
        positions = frames[state.preroll :]
        reason = reason_to_reject(positions, mesh, 1.0 / data["fps"], gravity, data["reject"])
        if not reason:
            return positions, attempt
    raise DrapeError(f"rejected {attempt} times, at last for {reason}; widen data.reject or calm data.start")


def reason_to_reject(
    positions: Float[np.ndarray, "frames vertices 3"],
    mesh: ClothMesh,
    dt: float,
    gravity: Float[np.ndarray, " 3"],
    bounds: Mapping[str, float],
) -> str:
    """Reason for which a sequence is not stored, or ''. One recorded frame is enough; ``bounds`` is ``data.reject``.

    * a position that is not finite;
    * ``strain``: an edge that is longer or shorter than at rest by more than this fraction;
    * ``energy``: kinetic and gravitational energy per mass [J/kg] that changes by more than this from one frame to
      the next: a blow-up of the solver, or a snap that no cloth shows.

    A sheet cannot pass through itself at its start (``initial_state``). That it may do so later is no reason: the cloth
    has no self-collision, as in the paper.
    """
    if not np.isfinite(positions).all():
        return "a position that is not finite"
    strain = np.abs(edge_strain(positions, mesh)).max()
    if strain > bounds["strain"]:
        return f"an edge strain of {strain:.3f} (bound {bounds['strain']})"
    change = np.abs(np.diff(external_energy_per_mass(positions, dt, gravity))).max(initial=0.0)
    if change > bounds["energy"]:
        return f"an energy change of {change:.2f} J/kg in one frame (bound {bounds['energy']})"
    return ""


def part_path(parts: Path, index: int) -> Path:
    """Path of a finished sequence, which waits until all are there."""
    return Path(parts) / f"{index:06d}.npz"


def save_part(parts: Path, index: int, positions: np.ndarray, attempts: int) -> None:
    """Store a sequence so that its file is either whole or absent."""
    path = part_path(parts, index)
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            np.savez(file, positions=positions, attempts=np.int64(attempts))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def load_part(parts: Path, index: int) -> tuple[Float[np.ndarray, "frames vertices 3"], int]:
    """Positions and attempts as :func:`save_part` stored them."""
    with np.load(part_path(parts, index), allow_pickle=False) as part:
        return part["positions"], int(part["attempts"])
