"""One sequence of a garment: simulated, controlled, repaired or drawn anew, and its twin. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from drape.blender.garment_attempt import Attempt, draw_attempt
from drape.blender.garment_choice import Choice, choose
from drape.blender.garment_quality import Crossing, measure_quality, reason_to_refuse
from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh

Simulate = Callable[..., np.ndarray]
"""``drape.blender.garment_cloth.simulate_garment``, handed in so that everything here runs without Blender."""


def make_garment_sequence(
    index: int, plan: Mapping, simulate: Simulate, crossing: Crossing, people: Path | None = None
) -> Part:
    """Sequence ``index`` of a plan, which shows what :func:`~drape.blender.garment_choice.choose` says.

    Attempt k = 1, 2, ... draws style and motion from ``numpy.random.default_rng([seed, index, k])`` and from nothing
    else, the body's measures come from (seed, number of the body): the result depends neither on other sequences nor on
    who computes it. An attempt that quality control refuses is repaired: simulated once more, with
    ``data.solver.repair`` steps per frame. If that is refused, too, the next attempt is drawn. ``people``: where people
    of anny are stored, if bodies are.

    Raises:
        DrapeError: all ``data.reject.attempts`` attempts were refused.
    """
    data, choice = plan["data"], choose(index, plan)
    refused: list[str] = []
    for number in range(1, data["reject"]["attempts"] + 1):
        try:
            attempt = draw_attempt(choice, data, np.random.default_rng([data["seed"], index, number]), people)
        except DrapeError as error:
            refused.append(str(error))
            continue
        for steps in (data["solver"]["steps"], data["solver"]["repair"]):
            simulated = _Simulated(attempt, plan, choice.fabric, steps, simulate)
            quality = simulated.quality(crossing)
            reason = reason_to_refuse(quality, data["reject"])
            if not reason:
                repaired = steps > data["solver"]["steps"]
                quality |= {"solver_steps": simulated.settings["quality"], "repaired": repaired, "refused": refused}
                return _part(index, plan, choice, number, simulated, quality)
            refused.append(reason)
    raise DrapeError(f"refused {number} times, at last for {refused[-1]}; widen data.reject, or choose another seed")


class _Simulated:
    """An attempt after Blender has moved it, and its twin."""

    def __init__(self, attempt: Attempt, plan: Mapping, fabric: str, steps: int, simulate: Simulate) -> None:
        self.attempt, self._data, self._simulate = attempt, plan["data"], simulate
        preset = plan["settings"][fabric]
        self.settings = preset | {"quality": max(preset["quality"], steps)}
        self.start = attempt.skinned[0]
        self.positions = self._from(self.start)

    def _from(self, start: np.ndarray) -> np.ndarray:
        """The recorded frames."""
        data = self._data
        gravity = np.array([0.0, 0.0, -float(data["gravity"])])
        frames = self._simulate(self.attempt.dressed, start, self.settings, data["contact"], gravity, data["fps"])
        return frames[data["settle"] :]

    def twin(self) -> np.ndarray:
        """The recorded frames from a start that is moved by N(0, ``data.twin``) [m], pins included."""
        moved = self.start + self.attempt.twin.normal(0.0, self._data["twin"], self.start.shape)
        return self._from(moved)

    def quality(self, crossing: Crossing) -> dict:
        """The numbers of quality control."""
        attempt, settle = self.attempt, self._data["settle"]
        mesh = ClothMesh.from_faces(attempt.garment.rest_positions.copy(), attempt.garment.faces.copy())
        body = attempt.dressed
        recorded = body.body_positions[settle:]
        return measure_quality(self.positions, mesh, recorded, body.body_faces, 1.0 / self._data["fps"], crossing)


def _part(index: int, plan: Mapping, choice: Choice, number: int, simulated: _Simulated, quality: dict) -> Part:
    data, attempt = plan["data"], simulated.attempt
    figure, garment = attempt.figure, attempt.garment
    twin = simulated.twin() if choice.split == "test" and data["twin"] > 0 else None
    if twin is not None:
        quality["twin_distance"] = float(np.linalg.norm(twin - simulated.positions, axis=-1).mean())
    name, body = f"{index:05d}", f"{choice.body:03d}"
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
            garment=name,
            body=body,
            fabric=choice.fabric,
            motion=choice.motion,
            split=choice.split,
            attempts=number,
            mass_per_vertex=float(simulated.settings["mass"]),
            friction=float(data["contact"]["friction"]),
            quality=quality,
            positions=simulated.positions,
            transforms=attempt.transforms[data["settle"] :].astype(np.float32),
            twin=twin,
        ),
    )
