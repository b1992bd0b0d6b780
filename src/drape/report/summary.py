"""Summary of a trained law, in a few lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from drape.metrics.record import MaterialRecord, RunRecord, SimulatorRecord, read_json


def summary(path: Path) -> str:
    """Lines on the record of a training at ``path``; of a trial run, which leaves none, only that."""
    if not path.is_file():
        return "a trial run: nothing was recorded"
    if path.name == SimulatorRecord.FILE:
        return _simulator(read_json(path))
    return _materials(read_json(path)) if path.name == MaterialRecord.FILE else _energy(RunRecord.load(path.parent))


def _materials(content: Mapping) -> str:
    told = content["provenance"]
    lines = [f"materials of PHYS (seed {told['seed']}, {told['frames']} frames, {told['steps']} steps):"]
    for fabric, numbers in content["estimates"].items():
        left = content["residuals"].get(fabric, {})
        forces = ", ".join(f"{name} {value:.3f}" for name, value in left.items()) or "no frame to judge"
        values = ", ".join(f"{name} {value:.3g}" for name, value in numbers.items())
        lines.append(f"  {fabric:8} {values}; residual over weight: {forces}")
    return "\n".join(lines)


def _simulator(content: Mapping) -> str:
    told, watched = content["training"], content["watched"]
    name = told["row"] if told["ablation"] == "none" else f"{told['row']} {told['ablation']}"
    effort = f"seed {told['seed']}, {told['iterations']} iterations, {told['seconds']:.0f} s"
    lines = [f"{name} has learned to simulate ({effort})"]
    if watched:
        lines.append(
            f"  watched sequences of the test split: error {watched['error_mm']:.1f} mm, inside the body "
            f"{watched['inside_percent']:.2f} %, {watched['ms_per_frame']:.0f} ms per frame"
        )
    return "\n".join(lines)


def _energy(run: RunRecord) -> str:
    """A line for each fabric: stiffness and Blender's, force residual and its bars, squared energy error."""
    name = run.model if run.ablation == "none" else f"{run.model} {run.ablation}"
    lines = [f"what {name} has learned (seed {run.seed}, {run.setting['steps']} steps, test split):"]
    fabrics = [key.partition("/")[2] for key in run.metrics if key.startswith("inertial_force_N/")]
    for fabric in fabrics:
        if fabric == "overall":
            continue
        stiffness, blender, forces, nothing, law, energy = (
            run.metrics.get(f"{quantity}/{fabric}", float("nan"))
            for quantity in (
                "stretch_stiffness_N_per_m",
                "blender_stiffness_N_per_m",
                "force_residual_N",
                "inertial_force_N",
                "spring_hinge_residual_N",
                "energy_error_J2",
            )
        )
        lines.append(
            f"  {fabric:8} stretching {stiffness:9.3g} N/m (Blender {blender:8.3g})   force residual {forces:6.3g} N "
            f"(nothing {nothing:.3g}, spring-hinge law {law:.3g})   energy error {energy:.3g} J2"
        )
    return "\n".join(lines)
