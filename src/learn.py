"""From recordings of your own cloth to a law that animates: ``python src/learn.py data.name=flag data.root=...``."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

from omegaconf import DictConfig

from drape import config as conf
from drape.data.hdf5 import GarmentFile
from drape.data.trajectories import open_trajectories
from drape.report.law_card import write_law_card

FINE = ("table.step=0.125", "bounds.energy=2e-2", "bounds.force=0.1")
"""Hinges of a limp fabric may store next to nothing somewhere, which tables can follow only so far."""


@conf.main("learn")
def main(config: DictConfig) -> None:
    folder, path = Path(config.folder), str(config.data.path)
    told = ["data=recorded", *(override for override in conf.typed() if override.lstrip("+~").startswith("data."))]
    scale = [f"scale={conf.chosen('scale')}", *(each for each in conf.typed() if each.startswith("scale."))]
    step("generate", *told)
    step("train", "model=eunet_hinge", *told, *scale, f"seed={config.seed}", f"hydra.run.dir={folder}")
    for fabric in (file := open_trajectories(path)).fabrics:
        tabulate(file, fabric, folder)
        print(write_law_card(path, fabric, folder))


def tabulate(file: GarmentFile, fabric: str, folder: Path) -> None:
    """Bake the law of one fabric and animate its held-out sequences, unless that has been done since it was trained."""
    table, checkpoint = folder / f"{fabric}.npz", folder / "checkpoints" / "last.ckpt"
    own = [f"fabric.name={fabric}", f"fabric.source={file.path}"]
    if not table.exists() or table.stat().st_mtime < checkpoint.stat().st_mtime:
        step("bake", f"checkpoint={checkpoint}", "fabric=own", *own, f"path={table}", *FINE)
    held = [each for each in file.sequences if (each.split, each.fabric) == ("test", fabric)]
    measured = folder / f"held_out_{fabric}"
    if not (measured / "held_out.csv").exists() or (measured / "held_out.csv").stat().st_mtime < table.stat().st_mtime:
        frames = min(each.num_frames for each in held) - 2
        step(
            "benchmark", "measure=held_out_own", f"measure.path={file.path}", f"fabrics.own.name={fabric}",
            f"energies.eunet_baked.table={table}", f"measure.sequences={len(held)}", f"measure.frames={frames}",
            f"folder={measured}",
        )  # fmt: skip


def step(program: str, *overrides: str) -> None:
    """Run one of the other entry points; where it ends with a sentence, this one does, with the same status."""
    print(f"\n$ {conf.command_line(program, list(overrides))}", flush=True)
    status = subprocess.run([sys.executable, str(Path(__file__).with_name(f"{program}.py")), *overrides]).returncode
    if status:
        print(f"stopped: {shlex.join(['src/' + program + '.py'])} ended with status {status}", file=sys.stderr)
        sys.exit(status)


if __name__ == "__main__":
    main()
