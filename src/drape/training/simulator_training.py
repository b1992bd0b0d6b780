"""Learn to simulate: from recorded garments, or from an incremental potential alone; the losses decide."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

import lightning
import numpy as np
import torch
from jaxtyping import Float
from lightning.pytorch.core.optimizer import LightningOptimizer
from torch import Tensor, nn

from drape.contact.penetration import Body, cleared
from drape.data.garment_datamodule import GarmentDataModule
from drape.data.garment_rollout import GarmentRollout
from drape.data.sequence_loader import Watched
from drape.energy.law.checkpoint import versions
from drape.errors import DrapeError
from drape.loss.potential import Potential
from drape.loss.prediction import PredictionLoss
from drape.metrics.record import SimulatorRecord
from drape.metrics.rollout_scores import ScoredRollout, rollout_scores
from drape.nets.products import round_products
from drape.simulators.neural.checkpoint import describe_simulator
from drape.simulators.neural.cloths import Cloths
from drape.simulators.neural.rollout_step import rollout_step
from drape.training.captured_step import CHECKED_EVERY, CapturedStep, CapturedSteps
from drape.training.curriculum import Curriculum
from drape.training.schedule import Schedule
from drape.training.simulator_task import Task, task_values

UPDATES = ("step", "rollout")
REACH = 0.1
"""Largest depth at which vertices of a first frame are looked for inside the body [m]."""
KEPT = 2
"""Watched sequences whose frames are kept until the next validation, to be looked at."""


class SimulatorTraining(lightning.LightningModule):
    """Minimises ``Σ weight · summand`` over rollouts of the network; wiring only.

    Supervised by :class:`~drape.loss.position.Position`, self-supervised by :class:`~drape.loss.potential.Potential`.
    States are detached between steps. Everything random depends on the seed, the iteration and the rank only, so that
    a training that was interrupted goes on as if it had not been. ``global_step`` counts iterations, i.e. rollouts,
    whatever the number of updates in each.

    Args:
        network: predicts accelerations [m/s²] of the vertices from a step.
        cloths: what the garments are made of.
        loss: summands by name; logged as ``train/loss/<summand>``, energies also as ``train/energy_J/<summand>``,
            with ``train/ms_per_step`` of a rollout.
        optimizer: makes the optimiser from the parameters.
        schedule: learning rate over the progress of the training.
        curriculum: how rollouts grow and begin.
        updates: one after each ``step`` of a rollout (HOOD), or one after the ``rollout`` (the paper's official code).
        noise: standard deviation of what is added to the free vertices at t-1 and t [m].
        clip: largest norm of a gradient.
        clearance: distance from the body at least at which a rollout begins [m].
        seed: of all that is random.
        data: whose fabrics the garments are made of.

    Raises:
        DrapeError: no loss, an incremental potential of garments without energies, another word for ``updates``; while
            training, a summand that is not finite (the summand, the step and the sample are named).
    """

    RECORD = SimulatorRecord.FILE
    """Name of the file that is left in the end."""

    def __init__(
        self,
        network: nn.Module,
        cloths: Cloths,
        loss: Mapping[str, PredictionLoss],
        optimizer: Callable[..., torch.optim.Optimizer],
        schedule: Schedule,
        curriculum: Curriculum,
        updates: str,
        noise: float,
        clip: float,
        clearance: float,
        seed: int,
        data: GarmentDataModule,
    ):
        super().__init__()
        if not loss:
            raise DrapeError("loss: no term is left to train on; choose one, for example loss=supervised")
        if updates not in UPDATES:
            raise DrapeError(f"training.updates: found {updates!r}; expected {' or '.join(UPDATES)}")
        energetic = any(isinstance(each, Potential) for each in loss.values())
        if energetic and not any(cloths.terms(material) for material in data.materials.values()):
            raise DrapeError(
                "loss: the garments have no elastic energy to minimise (model/cloths=recorded); choose "
                "model/cloths=eunet, phys or phys_estimated, or loss=supervised"
            )
        self.automatic_optimization = False
        self.network, self.cloths, self.materials = network, cloths, data.materials
        self.loss = nn.ModuleDict(loss)
        self._make_optimizer, self._schedule, self._curriculum = optimizer, schedule, curriculum
        self._updates, self._noise, self._clip, self._clearance = updates, noise, clip, clearance
        self._seed = seed
        self._captured = CapturedSteps[Task](self.values, list(network.parameters()))
        self._asks_device = any(hasattr(part, "asks_device") for part in (*network.modules(), *loss.values()))
        self.watched: list[ScoredRollout] = []

    @staticmethod
    def supplied(data: GarmentDataModule) -> dict[str, object]:
        """Arguments of the constructor from the data."""
        return {"data": data}

    @property
    def progress(self) -> float:
        """Of the training, from 0 to 1."""
        return self.global_step / max(self.trainer.max_steps, 1)

    def on_fit_start(self) -> None:
        """See :func:`round_products`."""
        round_products(self.device)

    def training_step(self, rollout: GarmentRollout, batch_idx: int) -> None:
        """Roll out, and update."""
        began = time.perf_counter()
        generator = torch.Generator().manual_seed((self._seed * 1_000_003 + self.global_step) * 64 + self.global_rank)
        length = min(self._curriculum.length(self.global_step), rollout.length)
        cloth = self.cloths.draw(rollout, self.materials, generator)
        rollout, x, v = self._begin(rollout, generator)
        contact = next((each.contact for each in self.loss.values() if isinstance(each, Potential)), None)
        touching = None if contact is None else contact.surface(rollout.mesh)
        optimizer = cast(torch.optim.Optimizer, self.optimizers())
        for group in optimizer.param_groups:
            group["lr"] = group["initial_lr"] * self._schedule(self.progress)
        sums: dict[str, Tensor] = {}
        is_checked = not x.is_cuda or (self.global_step + 1) % CHECKED_EVERY == 0
        for k in range(length):
            step = rollout_step(rollout, k, x, v, cloth, touching)
            near = step.near if x.is_cuda else None
            task = Task(step, near, rollout.x[k + 2], x.new_full((), self.progress))
            every = 1 if self._updates == "step" else length
            values = self._slopes(task, every)
            sums |= {name: sums.get(name, 0.0) + value for name, value in values.items() if "/" in name}
            if is_checked:
                self._check_finite(values, rollout)
            if (k + 1) % every == 0:
                self._update(optimizer, last=k + 1 == length)
            x, v = values["x_next"], (values["x_next"] - x) / rollout.dt
        logged: dict[str, Tensor | float] = {f"train/{name}": value / length for name, value in sums.items()}
        logged |= {"train/rollout_length": float(length)}
        logged |= {"train/ms_per_step": 1e3 * (time.perf_counter() - began) / length}
        self.log_dict(logged, batch_size=rollout.mesh.num_meshes)

    def _begin(
        self, rollout: GarmentRollout, generator: torch.Generator
    ) -> tuple[GarmentRollout, Float[Tensor, "vertices 3"], Float[Tensor, "vertices 3"]]:
        """The rollout, positions and velocities at t: noise, the garment outside of the body, or at rest."""
        noise = [self._noise * torch.randn(rollout.x[0].shape, generator=generator, dtype=torch.float64) for _ in "xv"]
        shift = [rollout.free[:, None] * each.to(rollout.x) for each in noise]
        x_prev, x = rollout.x[0] + shift[0], rollout.x[1] + shift[1]
        body = Body(rollout.body_faces, rollout.mesh_of_face, rollout.body[1])
        outside = cleared(x, rollout.mesh.mesh_of_vertex, body, self._clearance, REACH)
        v = (x - x_prev) / rollout.dt
        v = torch.where((outside != x).any(-1, keepdim=True), (rollout.x[1] - rollout.x[0]) / rollout.dt, v)
        if float(torch.rand((), generator=generator)) < self._curriculum.at_rest:
            return rollout.from_rest(), outside, torch.zeros_like(v)
        return rollout, outside, v

    def values(self, task: Task) -> dict[str, Tensor]:
        """See :func:`task_values`."""
        return task_values(self.network, cast(Iterable[PredictionLoss], self.loss.values()), task)

    def _slopes(self, task: Task, every: int) -> dict[str, Tensor]:
        """The :meth:`values`; the slopes of an ``every``-th of the total are added to those of the parameters.

        On a GPU as one graph, as far as network and losses can be captured and one process trains.
        """
        captured = self._graph(task)
        if captured is None:
            values = self.values(task)
            self.manual_backward(values["total"] / every)
            return values
        parameters = [each for each in self.network.parameters() if each.requires_grad]
        earlier = [each.grad for each in parameters]
        values = captured.replay(task)
        if every > 1:
            for parameter, before in zip(parameters, earlier, strict=True):
                if parameter.grad is not None:
                    now = parameter.grad / every
                    parameter.grad = now if before is None else before + now
        return values | {"x_next": values["x_next"].clone()}  # which the next replay is about to overwrite

    def _graph(self, task: Task) -> CapturedStep[Task] | None:
        if not task.step.x.is_cuda or self.trainer.world_size > 1 or self._asks_device:
            return None
        return self._captured.of(task)

    def _check_finite(self, values: Mapping[str, Tensor], rollout: GarmentRollout) -> None:
        """All at once: a GPU is waited for each time that one is asked."""
        shown = {name: value for name, value in values.items() if name.startswith("loss/")}
        if bool(torch.stack(list(shown.values())).isfinite().all()):
            return
        name, value = next((name, value) for name, value in shown.items() if not torch.isfinite(value))
        raise DrapeError(
            f"training stopped at step {self.global_step}: loss term {name.removeprefix('loss/')} is {float(value)} "
            f"for {', '.join(rollout.names)}; the last checkpoint is from before; lower the learning rate or look at "
            "the data"
        )

    def _update(self, optimizer: torch.optim.Optimizer, *, last: bool) -> None:
        """One update; Lightning is told of the last of an iteration only, so that it counts iterations."""
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self._clip)
        (optimizer if last else cast(LightningOptimizer, optimizer).optimizer).step()
        optimizer.zero_grad()

    def on_validation_epoch_start(self) -> None:
        """Forget what the last validation has animated."""
        self.watched.clear()

    def validation_step(self, watched: Watched, batch_idx: int) -> None:
        """Animate a whole sequence and score it."""
        rollout = rollout_scores(self.network, self.cloths, watched.sequence)
        if len(self.watched) < KEPT:
            self.watched.append(rollout)
        for name, value in rollout.scores.items():
            self.log(f"val/{name}", value, batch_size=1, on_epoch=True, sync_dist=True)

    def described(
        self, config: dict[str, Any], choices: Mapping[str, str], data: GarmentDataModule, seconds: float
    ) -> dict[str, Any]:
        """Self-description of a checkpoint; its example is a step of the first garment."""
        rollout = data.rollout(np.arange(1)).to(self.device)
        cloth = self.cloths.draw(rollout, self.materials, torch.Generator().manual_seed(0))
        v = (rollout.x[1] - rollout.x[0]) / rollout.dt
        material = data.materials[rollout.fabrics[0]]
        step = rollout_step(rollout, 0, rollout.x[1], v, cloth._replace(terms=self.cloths.terms(material)))
        told = dict(self.finish(config, choices, data, seconds).training)
        return describe_simulator(config, told, self.network, step, material)

    def finish(
        self, config: dict[str, Any], choices: Mapping[str, str], data: GarmentDataModule, seconds: float
    ) -> SimulatorRecord:
        """Record of the training so far."""
        watched = {k: float(v) for k, v in self.trainer.callback_metrics.items() if k.startswith("val/")}
        return SimulatorRecord(
            training={
                "row": choices["model"],
                "name": config["name"],
                "label": choices["label"],
                "ablation": choices["ablation"],
                "material": choices["material"],
                "scale": choices["scale"],
                "seed": config["seed"],
                "data": config["data"]["path"],
                "iterations": self.global_step,
                "seconds": round(seconds, 1),
                "parameters": sum(p.numel() for p in self.network.parameters()),
                "command": choices["command"],
                "versions": versions(),
            },
            watched={name.removeprefix("val/"): value for name, value in watched.items()},
        )

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """The optimiser; the schedule is applied in every iteration."""
        optimizer = self._make_optimizer(self.network.parameters())
        for group in optimizer.param_groups:
            group.setdefault("initial_lr", group["lr"])
        return optimizer
