"""What ``animate.py`` says: which energies a scene requires, and how an animation went."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drape.data.animation_hdf5 import AnimationFile
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.step import Step
from drape.metrics.position import distance_travelled, vertex_distance
from drape.report.table import Table
from drape.scene.scene import Scene
from drape.simulators.rollout import Rollout
from drape.simulators.simulator import Outcome
from drape.simulators.term_costs import search_seconds, term_costs


def explained(potential: IncrementalPotential, step: Step) -> Table:
    """The terms: why each is there, and what it costs at each evaluation and at each factorisation."""
    search = search_seconds(step)
    rows = tuple(
        (cost.name, cost.reason, f"{1e3 * cost.seconds:.2f}", f"{1e3 * cost.hessian_seconds:.2f}")
        for cost in term_costs(potential, step)
    )
    nearest = "no body: nearest faces are not searched"
    if search is not None:
        nearest = f"nearest faces of the body: {1e3 * search:.1f} ms a step"
    return Table("Energies of this scene", ("energy", "because", "energy and forces, ms", "Hessian, ms"), rows, nearest)


def animated(path: Path, scene: Scene, rollout: Rollout, made: Sequence[Path]) -> str:
    """How the frames went, what to do about those that did not converge, and where everything is."""
    with AnimationFile(path) as file:
        numbers = file.numbers()
        count, vertices = file.num_frames - 1, scene.mesh.num_vertices
        lines = [f"{scene.name}: {count} frames of {vertices} vertices, {scene.material.name}"]
        if scene.reference is not None:
            lines.append(_beside(file, scene.reference))
    seconds = numbers["seconds"][1:]
    lines.append(
        f"{1e3 * np.median(seconds):.0f} ms/frame (median), {np.nanmedian(numbers['iterations'][1:]):.0f} evaluations, "
        f"mean unbalanced force {np.nanmean(numbers['residual'][1:]):.2g} N a vertex"
    )
    if scene.obstacle is not None:
        inside = 100 * numbers["inside"][1:]
        lines.append(f"inside the body: mean {np.mean(inside):.3f} %, at most {np.max(inside):.2f} % of the vertices")
    for outcome, count in rollout.outcomes.items():
        if outcome is not Outcome.CONVERGED:
            lines.append(f"{count} of {len(rollout.seconds)} frames {outcome.value}")
    return "\n".join([*lines, *(os.path.relpath(file) for file in made)])


def _beside(file: AnimationFile, reference: np.ndarray) -> str:
    """Mean distance to the recorded frames, and how far these moved."""
    error = np.mean([vertex_distance(file.x(k), reference[k]) for k in range(1, file.num_frames)])
    travelled = distance_travelled(reference[: file.num_frames])
    return (
        f"mean distance to the recorded frames {1e3 * error:.1f} mm, {100 * error / travelled:.1f} % of the "
        f"{1e3 * travelled:.0f} mm that the cloth travelled on average"
    )
