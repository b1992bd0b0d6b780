"""A whole data set: simulated in worker processes, resumable after any interruption, packed into one HDF5 file."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import yaml
from tqdm import tqdm

from drape.blender.choice import choose
from drape.blender.garment_attempt import drawn_shape
from drape.blender.garment_people import save_people
from drape.blender.part import load_part, part_path
from drape.blender.plan import has_bodies, make_plan, make_request
from drape.blender.workers import processes_of, run_workers
from drape.data.difference import refuse_difference
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer, sheet_writer
from drape.data.parts_folder import OTHERWISE, claimed, parts_of
from drape.data.schema import GARMENTS, SHEETS, VERSIONS
from drape.data.stored_part import Header
from drape.errors import DrapeError
from drape.figure.phenotype import Phenotype


def generate(data: Mapping, material: Mapping, workers: int | str) -> tuple[GarmentFile, bool]:
    """Make the data set described by the config nodes at ``data.path``; returns (file, whether it was made now).

    Finished sequences wait in ``<path>.parts/`` until all are there, so after a kill at any moment the same call goes
    on and gives the same file; only sequences in flight are simulated again. ``workers``: Blender processes, or
    ``auto`` for one per CPU.

    Raises:
        DrapeError: a mistake in the config, another data set in the way, no Blender, a crashed worker, a full disk.
    """
    request, processes = make_request(data, material), processes_of(workers)
    path = Path(data["path"])
    parts = parts_of(path)
    if path.exists():
        file = GarmentFile(path, f"python src/generate.py data.path={path}")
        made = yaml.safe_load(file.attribute("config")) or {}
        refuse_difference({key: made.get(key, {}) for key in request}, request, path, OTHERWISE)
        shutil.rmtree(parts, ignore_errors=True)
        return file, False
    plan = make_plan(request)
    if has_bodies(plan["data"]):
        plan["schema_version"] = VERSIONS[GARMENTS]  # parts of another meaning are not taken
    try:
        with claimed(parts, _manifest(plan)):
            _make_people(parts, plan)
            _simulate(parts, plan, processes)
            _pack(parts, plan, path)
            shutil.rmtree(parts, ignore_errors=True)
    except OSError as error:
        raise DrapeError(
            f"{path}: {error}; finished sequences are kept in {parts}: make room or set the permissions, then run the "
            "same command again"
        ) from error
    return GarmentFile(path), True


def _manifest(plan: Mapping) -> dict:
    """Owner of the folder of parts; parts of sheets were other files once."""
    return dict(plan) if has_bodies(plan["data"]) else {**plan, "parts": "whole"}


def _indices(plan: Mapping) -> range:
    return range(sum(plan["data"]["counts"].values()))


def _missing(parts: Path, plan: Mapping) -> list[int]:
    return [index for index in _indices(plan) if not part_path(parts, index).exists()]


def _make_people(parts: Path, plan: Mapping) -> None:
    """Those that sequences still to be made show, if bodies are people of anny."""
    if has_bodies(plan["data"]):
        bodies = {choose(index, plan).body for index in _missing(parts, plan)}
        shapes = {body: drawn_shape(body, plan["data"]) for body in sorted(body for body in bodies if body is not None)}
        save_people(parts, {body: shape for body, shape in shapes.items() if isinstance(shape, Phenotype)})


def _simulate(parts: Path, plan: Mapping, processes: int) -> None:
    missing, count = _missing(parts, plan), len(_indices(plan))
    with tqdm(total=count, initial=count - len(missing), desc="simulating", unit=" sequences") as bar:
        for _ in run_workers(parts, missing, processes):
            bar.update()


def _pack(parts: Path, plan: Mapping, path: Path) -> None:
    """One file of all parts, one sequence at a time."""
    indices, header = _indices(plan), _header(plan)
    size = sum(part_path(parts, index).stat().st_size for index in indices)
    sheets = header.format == SHEETS
    with sheet_writer(path, header, len(indices), size) if sheets else data_writer(path, header, size) as writer:
        for index in indices:
            writer.add(load_part(parts, index))


def _header(plan: Mapping) -> Header:
    data = plan["data"]
    materials = {
        fabric: {"mass_per_vertex" if name == "mass" else name: value for name, value in settings.items()}
        for fabric, settings in plan["settings"].items()
    }
    return Header(
        source=f"blender {plan['blender_version']}",
        fps=float(data["fps"]),
        gravity=(0.0, 0.0, -float(data["gravity"])),
        materials=materials,
        config=yaml.safe_dump(plan, sort_keys=False),
        seed=data["seed"],
        format=GARMENTS if has_bodies(data) else SHEETS,
    )
