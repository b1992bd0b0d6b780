"""Recordings of anyone's cloth into one data set: ``python src/generate.py data=recorded data.root=...``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import yaml
from tqdm import tqdm

from drape.data.difference import refuse_difference
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import GroupWriter, data_writer
from drape.data.parts_folder import OTHERWISE
from drape.data.recorded.piece import fabric_of, masses, pinned_vertices
from drape.data.recorded.rest import RestShapes
from drape.data.recorded.sequence import Recording, find_sequences, read_recording
from drape.data.schema import RECORDED_MATERIAL, RECORDINGS
from drape.data.stored_part import Header, Part, StoredGarment, StoredSequence
from drape.data.trajectories import open_trajectories
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES, attribute_vector

FEWEST_FRAMES = 5
"""Of a sequence: two to start from, and some that show how the motion goes on."""


def convert_recorded(data: Mapping) -> tuple[GarmentFile, bool]:
    """Read all sequences of ``data.root`` into ``data.path``; returns (file, whether it was made now).

    Raises:
        DrapeError: a mistake in the config, a sequence that cannot be used, another data set in the way, a full disk.
    """
    path, paths = Path(data["path"]), find_sequences(Path(data["root"]))
    rest = None if data["rest"] in (None, "first") else Path(data["rest"]).absolute()
    paths = [each for each in paths if each.absolute() != rest]
    config = {"data": _stored(data)}
    config["bytes"] = {each.name: _bytes(each) for each in paths}
    if path.exists():
        file = open_trajectories(path)
        refuse_difference(yaml.safe_load(file.attribute("config")) or {}, config, path, OTHERWISE)
        return file, False
    fabrics = {each.name: fabric_of(each.stem, data["fabric"]) for each in paths}
    splits = split_of_sequences([each.name for each in paths], fabrics, data["test"])
    given = _attributes(data["attributes"] or {}, list(dict.fromkeys(fabrics.values())))
    unknown = dict.fromkeys(RECORDED_MATERIAL, 0.0)
    header = Header(
        source="recorded",
        fps=read_recording(paths[0], data).fps,
        gravity=(0.0, 0.0, -_positive(data["gravity"], "data.gravity", zero=True)),
        materials={fabric: unknown | given.get(fabric, {}) for fabric in dict.fromkeys(fabrics.values())},
        config=yaml.safe_dump(config, sort_keys=False),
        format=RECORDINGS,
    )
    try:
        with data_writer(path, header) as writer:
            _add_sequences(writer, _sequences(paths, data, header, fabrics, splits), given)
    except OSError as error:
        raise DrapeError(
            f"{path}: {error}; make room or set the permissions, then run the same command again"
        ) from error
    file = open_trajectories(path)
    try:
        _check_told_apart(file)
    except DrapeError:
        path.unlink()
        raise
    return file, True


def split_of_sequences(names: list[str], fabrics: Mapping[str, str], test: float | str) -> dict[str, str]:
    """Sequence -> train or test: a share of each fabric's, evenly spaced, or those that a text file names.

    Raises:
        DrapeError: one sequence only, no such file, a share outside 0 to 1, a fabric with nothing left to train on.
    """
    if len(names) < 2:
        raise DrapeError(
            f"data.root: found one sequence ({names[0]}); expected at least two, one to learn from and one that is "
            "held out; record another, or cut this one in two"
        )
    if isinstance(test, str):
        if not Path(test).is_file():
            raise DrapeError(
                f"data.test: {test}: no such file; expected a share, as 0.2, or a text file with a name a line"
            )
        listed = {line.strip() for line in Path(test).read_text(encoding="utf-8").splitlines() if line.strip()}
        unknown = sorted(listed - {Path(name).stem for name in names} - set(names))
        if unknown:
            raise DrapeError(f"data.test: {test}: found {unknown[0]}; expected names of sequences, as {names[0]}")
        splits = {name: "test" if {name, Path(name).stem} & listed else "train" for name in names}
    elif isinstance(test, int | float) and 0 < test < 1:
        splits = {}
        for fabric in dict.fromkeys(fabrics.values()):
            own = [name for name in names if fabrics[name] == fabric]
            held = max(1, round(test * len(own)))
            chosen = np.round((np.arange(held) + 0.5) * len(own) / held - 0.5).astype(int)
            splits |= {name: "test" if place in chosen else "train" for place, name in enumerate(own)}
    else:
        raise DrapeError(
            f"data.test: found {test!r}; expected a share between 0 and 1, or a text file with a name a line"
        )
    for fabric in dict.fromkeys(fabrics.values()):
        found = {splits[name] for name in names if fabrics[name] == fabric}
        if found != {"train", "test"}:
            raise DrapeError(
                f"data.test: found sequences of {fabric} for {', '.join(found)} only; expected at least one for "
                "training and one for the test; record more, or choose others"
            )
    return splits


def _add_sequences(writer: GroupWriter, parts: Iterator[Part], given: Mapping[str, Mapping[str, float]]) -> None:
    """Add all; the mass of a vertex of a fabric is the mean over its training sequences, unless it is ``given``."""
    seen: dict[str, list[float]] = {}
    for part in parts:
        writer.add(part)
        if part.sequence.split == "train":
            seen.setdefault(part.sequence.fabric, []).append(part.sequence.mass_per_vertex)
    for fabric, found in seen.items():
        if "mass_per_vertex" not in given.get(fabric, {}):
            writer.set_mass(fabric, float(np.mean(found)))


def _sequences(
    paths: list[Path], data: Mapping, header: Header, fabrics: Mapping[str, str], splits: Mapping[str, str]
) -> Iterator[Part]:
    """Sequences that have mesh, pins and masses in common are of one garment."""
    shapes = RestShapes(data)
    pieces: dict[tuple[bytes, ...], str] = {}
    for number, path in enumerate(tqdm(paths, desc="reading", unit=" sequences")):
        recording = read_recording(path, data)
        _check_motion(recording, header.fps, paths[0])
        mesh = shapes.mesh(recording)
        pinned = pinned_vertices(recording, mesh, data["pins"])
        mass = masses(recording, mesh, fabrics[path.name], data["mass"])
        garment = StoredGarment("sheet", "", mesh.rest_positions, mesh.faces, pinned, mass)
        key = tuple(array.tobytes() for array in (garment.rest_positions, garment.faces, pinned, mass))
        sequence = StoredSequence(
            name=f"{number:06d}",
            body="",
            motion=path.name,
            split=splits[path.name],
            garment=pieces.setdefault(key, str(len(pieces))),
            fabric=fabrics[path.name],
            mass_per_vertex=float(mass.mean()),
            positions=recording.positions,
        )
        yield Part(None, garment, sequence)


def _check_motion(recording: Recording, fps: float, first: Path) -> None:
    if len(recording.positions) < FEWEST_FRAMES:
        raise DrapeError(
            f"{recording.path}: found {len(recording.positions)} frames; expected at least {FEWEST_FRAMES}, as "
            "forces show in three that follow each other; record longer sequences, or leave this one out"
        )
    if not np.isclose(recording.fps, fps):
        raise DrapeError(
            f"{recording.path}: found {recording.fps:g} frames per second, and {fps:g} in {first.name}; expected one "
            "rate for all sequences; put them into data sets of their own"
        )


def _attributes(given: Mapping[str, Mapping[str, object]], fabrics: list[str]) -> dict[str, dict[str, float]]:
    """The node ``data.attributes``."""
    unknown = [name for name in given if name not in fabrics]
    wrong = [key for values in given.values() for key in values if key not in ATTRIBUTES]
    if unknown or wrong:
        raise DrapeError(
            f"data.attributes: found {(unknown or wrong)[0]}; expected of {', '.join(fabrics)} some of "
            f"{', '.join(ATTRIBUTES)}"
        )
    return {
        name: {key: _positive(value, f"data.attributes.{name}.{key}", zero=True) for key, value in values.items()}
        for name, values in given.items()
    }


def _check_told_apart(file: GarmentFile) -> None:
    """Two fabrics that have the same attributes would be one to the networks."""
    seen: dict[tuple[float, ...], str] = {}
    for name in file.fabrics:
        vector = tuple(attribute_vector(file.materials[name], dict.fromkeys(ATTRIBUTES, 1.0)))
        if vector in seen:
            raise DrapeError(
                f"data.attributes: {seen[vector]} and {name} have the same ({', '.join(ATTRIBUTES)}); expected fabrics "
                "that differ in one at least: give what is known, as data.attributes={"
                + name
                + ": {bending_stiffness: 2}}, "
                "or learn each from a data set of its own"
            )
        seen[vector] = name


def _positive(value: object, where: str, *, zero: bool = False) -> float:
    if not isinstance(value, int | float) or not np.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise DrapeError(f"{where}: found {value!r}; expected a number {'from 0 on' if zero else 'above 0'}")
    return float(value)


def _stored(data: Mapping) -> dict:
    """Config as a file keeps it: null as data sets have it that were made when there was no null."""
    unsaid = {"path", *(key for key in ("object", "rest_object") if data[key] is None)}
    stored = {key: value for key, value in data.items() if key not in unsaid}
    return stored | {"scale": 1.0 if data["scale"] is None else data["scale"], "up_axis": data["up_axis"] or "z"}


def _bytes(path: Path) -> int:
    """Bytes of a file or a folder: another recording under the same name is another data set."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
