"""A whole data set: simulated in worker processes, resumable after any interruption, packed into one HDF5 file."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import yaml
from tqdm import tqdm

from drape.blender.plan import make_plan, make_request
from drape.blender.sequence import cloth_mesh, fabric_of, load_part, part_path, split_of
from drape.blender.workers import processes_of, run_workers
from drape.data.difference import refuse_difference
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import sheet_writer
from drape.data.parts_folder import OTHERWISE, claimed, parts_of
from drape.data.schema import SHEETS, SPLITS
from drape.data.sheets import SHEET, sheet_name
from drape.data.stored_part import Header, Part, StoredGarment, StoredSequence
from drape.data.trajectories import open_trajectories
from drape.errors import DrapeError


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
        file = open_trajectories(path)
        made = yaml.safe_load(file.attribute("config")) or {}
        refuse_difference({key: made.get(key, {}) for key in request}, request, path, OTHERWISE)
        shutil.rmtree(parts, ignore_errors=True)
        return file, False
    plan = make_plan(request)
    try:
        with claimed(parts, plan):
            _simulate(parts, plan, processes)
            _pack(parts, plan, path)
            shutil.rmtree(parts, ignore_errors=True)
    except OSError as error:
        raise DrapeError(
            f"{path}: {error}; finished sequences are kept in {parts}: make room or set the permissions, then run the "
            "same command again"
        ) from error
    return GarmentFile(path), True


def _count(plan: Mapping) -> int:
    return plan["data"]["counts"]["train"] + plan["data"]["counts"]["test"]


def _simulate(parts: Path, plan: Mapping, processes: int) -> None:
    count = _count(plan)
    missing = [index for index in range(count) if not part_path(parts, index).exists()]
    with tqdm(total=count, initial=count - len(missing), desc="simulating", unit=" sequences") as bar:
        for _ in run_workers(parts, missing, processes):
            bar.update()


def _pack(parts: Path, plan: Mapping, path: Path) -> None:
    size = sum(part_path(parts, index).stat().st_size for index in range(_count(plan)))
    mesh, pinned = cloth_mesh(plan["data"])
    fabrics = list(plan["settings"])
    with sheet_writer(path, _header(plan), _count(plan), size) as writer:
        for index in range(_count(plan)):
            positions, attempts = load_part(parts, index)
            fabric = fabrics[fabric_of(index, len(fabrics))]
            sequence = StoredSequence(
                name=sheet_name(index),
                body="",
                motion="",
                split=SPLITS[split_of(index, plan["data"]["counts"])],
                garment=SHEET,
                fabric=fabric,
                mass_per_vertex=float(plan["settings"][fabric]["mass"]),
                attempts=attempts,
                positions=positions,
            )
            writer.add(Part(None, StoredGarment(SHEET, "", mesh.rest_positions, mesh.faces, pinned), sequence))


def _header(plan: Mapping) -> Header:
    data = plan["data"]
    materials = {
        fabric: {"mass_per_vertex" if name == "mass" else name: value for name, value in settings.items()}
        for fabric, settings in plan["settings"].items()
    }
    return Header(
        source=f"blender {plan['blender_version']}",
        materials=materials,
        fps=float(data["fps"]),
        gravity=(0.0, 0.0, -float(data["gravity"])),
        seed=data["seed"],
        config=yaml.safe_dump(plan, sort_keys=False),
        format=SHEETS,
    )
