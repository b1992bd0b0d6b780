"""Baselines without an energy: motions that follow from a recorded sequence."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from drape.data.recorded_scene import START
from drape.data.sequence import GarmentSequence
from drape.errors import DrapeError
from drape.scene.follow import follow
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome, StepResult


class Baseline(ABC):
    """A simulator of one recorded garment that needs no energy; pinned vertices are led as in every simulator.

    Args:
        scene: of the sequence, as :func:`drape.data.recorded_scene.recorded_scene` makes it.
        sequence: what was recorded, from the first frame on.
    """

    def __init__(self, scene: Scene, sequence: GarmentSequence):
        self.scene = scene
        self.sequence = sequence

    @abstractmethod
    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        """Positions of the vertices at frame ``frame + 1`` of the scene, from the state at ``frame`` [m]."""

    def step(self, state: State, frame: int) -> StepResult:
        """The state at frame ``frame + 1`` from that at ``frame``; velocities are those of the step."""
        x = np.array(self.positions(state, frame))
        if self.scene.pins is not None:
            x[self.scene.pins.vertices] = self.scene.pins.at(frame + 1)
        return StepResult(State(x, (x - state.x) / self.scene.dt), Outcome.CONVERGED, 0, 0.0)


class Frozen(Baseline):
    """``x' = x``."""

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return state.x


class Ballistic(Baseline):
    """``x' = x + dt v + dt² g``: the implicit Euler step without elastic energy and contact."""

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return state.x + self.scene.dt * state.v + self.scene.dt**2 * self.scene.gravity


STARTS = ("recorded", "rest")


class Skinned(Baseline):
    """``x_k = M_k M_0⁻¹ x_0`` with ``M = Σ w_j T_j`` the blended transforms of the joints at each vertex.

    ``start``: what is carried. ``recorded`` is the recorded garment at the start of the scene, as every simulator
    starts from it, so that errors begin at zero; where the data have no joints, each vertex is carried by the face of
    the body that is nearest then. ``rest`` is the rest shape of the garment, ``x_k = M_k X``, as a skinning model draws
    it.

    Raises:
        DrapeError: an unknown start, or no skinning weights for ``rest``.
    """

    def __init__(self, scene: Scene, sequence: GarmentSequence, start: str = "recorded"):
        super().__init__(scene, sequence)
        if start not in STARTS:
            raise DrapeError(f"simulator.start: found {start!r}; expected {' or '.join(STARTS)}")
        transforms = sequence.transforms if sequence.is_carried else None
        if start == "recorded" and transforms is not None:
            self.frames = _carried(scene, sequence, transforms[START : START + scene.frames + 1])
        elif start == "recorded" and scene.obstacle is not None:
            self.frames = follow(scene.obstacle, scene.initial.x)
        elif sequence.skinned is not None:
            self.frames = sequence.skinned[START:]
        else:
            raise DrapeError(
                f"{sequence.file.path}: sequences/{sequence.name}: has no skinning weights of the garment; "
                "simulator.start=rest expects them; choose simulator.start=recorded, which the nearest faces carry"
            )

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return self.frames[frame + 1]


def _carried(
    scene: Scene, sequence: GarmentSequence, transforms: Float[np.ndarray, "frames joints 4 4"]
) -> Float[np.ndarray, "frames vertices 3"]:
    """``M_k M_0⁻¹ x_0`` of each vertex."""
    bones, weights = (sequence.file.array(f"garments/{sequence.garment}/{name}") for name in ("bones", "weights"))
    local = np.linalg.solve(_blended(transforms[0], bones, weights), _homogeneous(scene.initial.x)[..., None])
    return np.stack([(_blended(each, bones, weights) @ local)[:, :3, 0] for each in transforms])


def _blended(transforms: np.ndarray, bones: np.ndarray, weights: np.ndarray) -> Float[np.ndarray, "vertices 4 4"]:
    return np.einsum("vb,vbij->vij", weights, transforms[bones])


def _homogeneous(x: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 4"]:
    return np.concatenate([x, np.ones((len(x), 1))], axis=1)


class Twin(Baseline):
    """The perturbed twin of the data; its error is the noise floor.

    Raises:
        DrapeError: the sequence has none.
    """

    def __init__(self, scene: Scene, sequence: GarmentSequence):
        super().__init__(scene, sequence)
        if sequence.twin is None:
            raise DrapeError(
                f"{sequence.file.path}: sequences/{sequence.name}: has no twin; simulator=twin expects the recording "
                "of a second, perturbed start; generate the data with data.twin=1e-6, or choose another simulator"
            )
        self.frames = sequence.twin

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return self.frames[START + frame + 1]
