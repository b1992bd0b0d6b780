"""Card of a law learned from recordings: its constants, and its error on held-out sequences."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import torch

from drape.data.trajectories import open_trajectories
from drape.data.whole_file import whole_file
from drape.energy.law.baked.file import read_baked

NAMES = {"eunet_baked": "learned law", "spring_hinge": "fitted spring-hinge law"}


def write_law_card(data: str, fabric: str, folder: Path) -> str:
    """The card of ``<folder>/<fabric>.npz``, as text; it is kept as ``<fabric>.md`` next to the table.

    Raises:
        DrapeError: no table, or a damaged one.
    """
    table = folder / f"{fabric}.npz"
    law, file = read_baked(table), open_trajectories(data)
    stiffness = law.slopes(torch.zeros(1, 2, dtype=torch.float64)).hessian[0].diagonal().tolist()
    shown = file.sequence(file.split("train")[0])
    density = shown.mass.sum() / (law.face_area * shown.mesh.num_faces)
    rows = _held_out(folder / f"held_out_{fabric}" / "held_out.csv")
    steps = _steps(rows)
    lines = [
        f"# The law of {fabric}",
        "",
        f"* learned from {len(file.split('train'))} sequences of {data}, {1 / file.dt:g} frames per second",
        f"* edges at rest: springs of {stiffness[0]:.4g} N/m, hinges of {stiffness[1]:.3g} J",
        f"* dampers of {law.damper:.2g} kg/s along edges, drag of the air of {law.drag:.2g} kg/s on a vertex",
        f"* {density:.3g} kg/m2, faces of {1e4 * law.face_area:.2f} cm2",
        *(f"* {line}" for line in law.certificate.text().splitlines()),
        "",
        "| held-out sequences | steps a frame | error, mm | of the way, % | ms a frame |",
        "|---|---:|---:|---:|---:|",
        *(
            f"| {NAMES.get(row['energy'], row['energy'])} | {row['steps']} | {float(row['error_mm']):.1f} | "
            f"{float(row['error_percent']):.1f} | {float(row['ms_per_frame']):.0f} |"
            for row in rows
        ),
        "",
        "Animate with it:",
        "",
        f"    python src/animate.py scene=held_out scene.path={data} fabric=own fabric.name={fabric} "
        f"energy.table={table}{steps}",
        f"    python src/animate.py scene=custom scene.mesh=garment.obj scene.mass.areal_density={density:.3g} "
        f"fabric=own energy.table={table}{steps}",
    ]
    text = "\n".join(lines) + "\n"
    card = folder / f"{fabric}.md"
    with whole_file(card) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return f"\n{text}\n{os.path.relpath(card)}"


def _held_out(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _steps(rows: list[dict[str, str]]) -> str:
    """The setting of as many steps a frame as the learned law had where it was nearest; nothing for a single one."""
    learned = [row for row in rows if row["energy"] == "eunet_baked"]
    best = min(learned, key=lambda row: (float(row["error_mm"]), int(row["steps"])))["steps"]
    return "" if best == "1" else f" simulator.steps={best}"
