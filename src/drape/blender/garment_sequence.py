"""A garment on a moving body: simulated, controlled, repaired, and its twin. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.blender.choice import Choice
from drape.blender.garment_attempt import draw_attempt
from drape.blender.garment_quality import Crossing, measure_quality, reason_to_refuse
from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.geometry.mesh import ClothMesh

Simulate = Callable[..., np.ndarray]
"""``drape.blender.garment_cloth.simulate_garment``, handed in so that everything here runs without Blender."""


class DrawnGarment:
    """Garment number ``index`` of a plan: style and motion are drawn, the body's measures come from its number.

    ``people``: where people of anny are stored, if bodies are.

    Raises:
        DrapeError: see :func:`draw_attempt`.
    """

    def __init__(
        self, index: int, plan: Mapping, choice: Choice, rng: np.random.Generator, simulate: Simulate,
        crossing: Crossing, people: Path | None = None,
    ) -> None:  # fmt: skip
        self.index, self.data, self.choice = index, plan["data"], choice
        self.preset, self.crossing, self._simulate = plan["settings"][choice.fabric], crossing, simulate
        self.attempt = draw_attempt(choice, self.data, rng, people)

    @property
    def steps(self) -> tuple[int, int]:
        """At first; and to repair a sequence that quality control has refused."""
        return self.data["solver"]["steps"], self.data["solver"]["repair"]

    def simulated(self, steps: int) -> SimulatedGarment:
        """Its recorded frames, with at least so many solver steps per frame."""
        return SimulatedGarment(self, steps)

    def frames(self, start: np.ndarray, settings: Mapping) -> Float[np.ndarray, "frames vertices 3"]:
        """The recorded frames from a ``start`` [m]."""
        data = self.data
        gravity = np.array([0.0, 0.0, -float(data["gravity"])])
        frames = self._simulate(self.attempt.dressed, start, settings, data["contact"], gravity, data["fps"])
        return frames[data["settle"] :]


class SimulatedGarment:
    """A garment after Blender has moved it."""

    def __init__(self, drawn: DrawnGarment, steps: int) -> None:
        self._drawn, self._repaired = drawn, steps > drawn.steps[0]
        self._settings = {**drawn.preset, "quality": max(drawn.preset["quality"], steps)}
        self._positions = drawn.frames(drawn.attempt.skinned[0], self._settings)
        self._quality = self._measured()

    def _measured(self) -> dict:
        drawn, garment, body = self._drawn, self._drawn.attempt.garment, self._drawn.attempt.dressed
        mesh = ClothMesh.from_faces(garment.rest_positions.copy(), garment.faces.copy())
        recorded, dt = body.body_positions[drawn.data["settle"] :], 1.0 / drawn.data["fps"]
        return measure_quality(self._positions, mesh, recorded, body.body_faces, dt, drawn.crossing)

    def reason_to_refuse(self) -> str:
        """That of quality control."""
        return reason_to_refuse(self._quality, self._drawn.data["reject"])

    def _twin(self) -> np.ndarray:
        """The recorded frames from a start that is moved by N(0, ``data.twin``) [m], pins included."""
        drawn, start = self._drawn, self._drawn.attempt.skinned[0]
        return drawn.frames(start + drawn.attempt.twin.normal(0.0, drawn.data["twin"], start.shape), self._settings)

    def part(self, attempt: int, refused: Sequence[str]) -> Part:
        """Stored form; of test sequences with a twin."""
        data, choice, drawn = self._drawn.data, self._drawn.choice, self._drawn.attempt
        steps = self._settings["quality"]
        quality = self._quality | {"solver_steps": steps, "repaired": self._repaired, "refused": list(refused)}
        twin = self._twin() if choice.split == "test" and data["twin"] > 0 else None
        if twin is not None:
            quality["twin_distance"] = float(np.linalg.norm(twin - self._positions, axis=-1).mean())
        figure, garment, name, body = drawn.figure, drawn.garment, f"{self._drawn.index:05d}", f"{choice.body:03d}"
        return Part(
            StoredBody(figure.rest_positions, figure.faces, figure.bones, figure.weights, asdict(figure.shape)),
            StoredGarment(
                kind=garment.kind,
                body=body,
                rest_positions=garment.rest_positions,
                faces=garment.faces,
                pinned=garment.pinned,
                bones=garment.bones,
                weights=garment.weights,
                style=asdict(garment.style),
            ),
            StoredSequence(
                name=name,
                body=body,
                motion=choice.motion,
                split=choice.split,
                garment=name,
                fabric=choice.fabric,
                mass_per_vertex=float(self._settings["mass"]),
                friction=float(data["contact"]["friction"]),
                attempts=attempt,
                quality=quality,
                positions=self._positions,
                transforms=drawn.transforms[data["settle"] :].astype(np.float32),
                twin=twin,
            ),
        )
