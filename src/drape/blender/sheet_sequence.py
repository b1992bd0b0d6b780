"""A sheet alone: random start, simulation, acceptance. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from drape.blender.choice import Choice
from drape.blender.initial_state import random_state
from drape.data.motion import edge_strain, external_energy_per_mass
from drape.data.sheets import SHEET, sheet_name
from drape.data.stored_part import Part, StoredGarment, StoredSequence
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh

Simulate = Callable[..., np.ndarray]
"""``drape.blender.cloth.simulate``, handed in so that everything here can be tested without Blender."""


def cloth_mesh(data: Mapping) -> tuple[ClothMesh, Int[np.ndarray, " pinned"]]:
    """The square sheet of a data set, and its pinned vertices: the two top corners."""
    mesh = square_grid(data["size"], data["resolution"], data["pattern"])
    return mesh, np.array([0, data["resolution"] - 1])


class DrawnSheet:
    """Sheet number ``index`` of a plan in a random start; it moves for some frames before it is recorded."""

    def __init__(
        self, index: int, plan: Mapping, choice: Choice, rng: np.random.Generator, simulate: Simulate
    ) -> None:
        self.index, self.data, self.choice, self._simulate = index, plan["data"], choice, simulate
        self.settings = plan["settings"][choice.fabric]
        self.mesh, self.pinned = cloth_mesh(self.data)
        self.gravity = np.array([0.0, 0.0, -float(self.data["gravity"])])
        stiffness, rest = self.settings["bending_stiffness"], self.mesh.rest_positions
        self._start = random_state(rest, self.pinned, self.data["start"], stiffness, rng)

    @property
    def steps(self) -> tuple[int]:
        """Those of the preset: a sheet is not repaired."""
        return (self.settings["quality"],)

    def simulated(self, steps: int) -> SimulatedSheet:
        """Its recorded frames."""
        start, mesh = self._start, self.mesh
        acceleration = np.tile(self.gravity, (start.preroll + self.data["frames"] - 1, 1))
        acceleration[: start.preroll] += start.push
        settings = {**self.settings, "quality": steps}
        frames = self._simulate(
            mesh.rest_positions, mesh.faces, self.pinned, settings, start.positions, acceleration, self.data["fps"]
        )
        return SimulatedSheet(self, frames[start.preroll :])


class SimulatedSheet:
    """A sheet after Blender has moved it."""

    def __init__(self, drawn: DrawnSheet, positions: Float[np.ndarray, "frames vertices 3"]) -> None:
        self._drawn, self._positions = drawn, positions

    def reason_to_refuse(self) -> str:
        """See :func:`reason_to_reject`."""
        drawn, data = self._drawn, self._drawn.data
        return reason_to_reject(self._positions, drawn.mesh, 1.0 / data["fps"], drawn.gravity, data["reject"])

    def part(self, attempt: int, refused: Sequence[str]) -> Part:
        """Stored form; a sheet has no numbers of quality control."""
        drawn, name = self._drawn, sheet_name(self._drawn.index)
        sequence = StoredSequence(
            name=name,
            body="",
            motion="",
            split=drawn.choice.split,
            garment=SHEET,
            fabric=drawn.choice.fabric,
            mass_per_vertex=float(drawn.settings["mass"]),
            attempts=attempt,
            positions=self._positions,
        )
        return Part(None, StoredGarment(SHEET, "", drawn.mesh.rest_positions, drawn.mesh.faces, drawn.pinned), sequence)


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
