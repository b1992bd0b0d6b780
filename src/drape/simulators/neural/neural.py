"""A trained network as a simulator: one evaluation a frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import nn

from drape.energy.scene_step import SceneSteps
from drape.energy.step import Step
from drape.scene.mass import vertex_masses
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.advance import advance
from drape.simulators.device import check_device
from drape.simulators.neural.cloths import Cloths
from drape.simulators.simulator import Outcome, StepResult


class NeuralSimulator:
    """``x' = x + dt (v + dt a)`` with the accelerations a that ``network`` predicts for the frame.

    Positions are kept in float64; the network works in its own precision, on differences.

    Args:
        network: predicts accelerations [m/s²] from a step.
        cloths: what the network is told of the scene's fabric, and what it weighs.
        scene: what is animated.
        device: where.

    Raises:
        DrapeError: a device that is not there.
    """

    def __init__(self, network: nn.Module, cloths: Cloths, scene: Scene, device: str = "cpu"):
        check_device(device)
        known = cloths.of(scene.material)
        if known.areal_density is not None:
            scene = replace(scene, mass=vertex_masses(scene.mesh, {"areal_density": known.areal_density}))
        self.scene = scene
        self.network = network.to(device)
        self.steps = SceneSteps(scene, known.attributes, device, getattr(network, "contact", None))
        self.fabric = cloths.terms(scene.material)

    @torch.inference_mode()
    def step(self, state: State, frame: int) -> StepResult:
        """The state at frame ``frame + 1`` from that at ``frame``; the same one if the prediction is not finite."""
        origin = self.steps.origin(state)
        step = self._led(self.steps.step(state, float(frame), frame + 1.0), state, frame + 1.0)
        x = advance(self.network, step).cpu().numpy() + origin
        if not np.isfinite(x).all():
            return StepResult(state, Outcome.NOT_PREDICTED, 1, 0.0)
        if self.scene.pins is not None:
            x[self.scene.pins.vertices] = self.steps.pin_targets(frame + 1.0)
        return StepResult(State(x, (x - state.x) / self.scene.dt), Outcome.CONVERGED, 1, 0.0)

    def _led(self, step: Step, state: State, stop: float) -> Step:
        """Pinned vertices with the velocity at which they are led."""
        led = (self.steps.pinned(step.x, state, stop) - step.x) / step.dt
        known = replace(step, v=torch.where(step.free[:, None], step.v, led), fabric=self.fabric)
        return known if step.obstacle is None else known.with_near(step.near, step.surface)
