"""A whole data set: simulated in worker processes, resumable after any interruption, packed into one HDF5 file."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml
from tqdm import tqdm

from drape.blender.plan import make_plan, make_request
from drape.blender.sequence import cloth_mesh, fabric_of, load_part, part_path, split_of
from drape.blender.workers import processes_of, run_workers
from drape.data.difference import refuse_difference
from drape.data.hdf5 import TrajectoryFile
from drape.data.hdf5_writer import DatasetHeader, StoredSequence, write_trajectories
from drape.data.parts_folder import OTHERWISE, claimed, parts_of
from drape.errors import DrapeError


def generate(data: Mapping, material: Mapping, workers: int | str) -> tuple[TrajectoryFile, bool]:
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
        file = TrajectoryFile(path)
        made = yaml.safe_load(file.attribute("config")) or {}
        refuse_difference({key: made.get(key, {}) for key in request}, request, path, OTHERWISE)
        shutil.rmtree(parts, ignore_errors=True)
        return file, False
    plan = make_plan(request)
    try:
        with claimed(parts, plan):
            _simulate(parts, plan, processes)
            write_trajectories(path, _header(plan), _stored(parts, plan), _count(plan))
            shutil.rmtree(parts, ignore_errors=True)
    except OSError as error:
        raise DrapeError(
            f"{path}: {error}; finished sequences are kept in {parts}: make room or set the permissions, then run the "
            "same command again"
        ) from error
    return TrajectoryFile(path), True


def _count(plan: Mapping) -> int:
    return plan["data"]["counts"]["train"] + plan["data"]["counts"]["test"]


def _simulate(parts: Path, plan: Mapping, processes: int) -> None:
    count = _count(plan)
    missing = [index for index in range(count) if not part_path(parts, index).exists()]
    with tqdm(total=count, initial=count - len(missing), desc="simulating", unit=" sequences") as bar:
        for _ in run_workers(parts, missing, processes):
            bar.update()


def _stored(parts: Path, plan: Mapping) -> Iterator[StoredSequence]:
    for index in range(_count(plan)):
        positions, attempts = load_part(parts, index)
        fabric = fabric_of(index, len(plan["settings"]))
        yield StoredSequence(positions, fabric, split_of(index, plan["data"]["counts"]), attempts)


def _header(plan: Mapping) -> DatasetHeader:
    data = plan["data"]
    mesh, pinned = cloth_mesh(data)
    materials = {
        fabric: {"mass_per_vertex" if name == "mass" else name: value for name, value in settings.items()}
        for fabric, settings in plan["settings"].items()
    }
    return DatasetHeader(
        mesh=mesh,
        pinned=pinned,
        materials=materials,
        fps=float(data["fps"]),
        gravity=(0.0, 0.0, -float(data["gravity"])),
        seed=data["seed"],
        blender_version=plan["blender_version"],
        config=yaml.safe_dump(plan, sort_keys=False),
    )
