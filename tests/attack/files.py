"""Attack the readers: small valid files of every format, damaged systematically, read as the commands read them.

``python -m tests.attack.files`` prints what was refused by a sentence, what ended in a traceback, and which nonsense
was accepted, with a list of the last two. Flipped bytes that leave a whole file of finite numbers are no nonsense.
"""

from __future__ import annotations

import collections
import copy
import json
import resource
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import torch
import trimesh
from tests import animations, garments, trajectories
from tests.integration.conftest import write_swaying
from tests.recordings import as_version_1
from tests.trajectories import MESH

from drape.config.resolvers import SHIPPED, _estimates
from drape.data.animation_hdf5 import AnimationFile
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer
from drape.data.schema import RECORDED_MATERIAL, RECORDINGS
from drape.data.stored_part import Part, StoredGarment
from drape.data.trajectories import open_trajectories
from drape.energy.law.baked.file import _digest, read_baked
from drape.energy.law.load_law import load_law
from drape.errors import DrapeError
from drape.figure.bvh_file import load_bvh
from drape.scene.material import Material
from drape.scene.obstacle_file import read_obstacle

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
VALUES = {"text": "word", "vector": np.ones(7), "nan": np.nan, "inf": np.inf, "negative": -1.0, "huge": 1e300}
VALUES |= {"empty": ""}
"""What an attribute becomes."""


class Case(NamedTuple):
    """One damaged file."""

    name: str
    path: Path
    read: Callable[[Path], object]
    must_fail: bool


def read_cloth(path: Path) -> None:
    """As training does."""
    file = open_trajectories(path)
    for sequence in file.sequences:
        for name in ("positions", "mesh", "pinned", "mass"):
            getattr(sequence, name)
    for name in ("materials", "gravity", "dt"):
        getattr(file, name)


def read_garments(path: Path) -> None:
    """As an evaluation does."""
    with GarmentFile(path) as file:
        file.check_frames()
        for name in file.names:
            sequence = file.sequence(name)
            file.mesh(sequence.garment)
        for name in ("gravity", "dt", "fabrics", "source"):
            getattr(file, name)


def read_animation(path: Path) -> None:
    """As the exporter does."""
    with AnimationFile(path) as file:
        file.trajectory()
        file.numbers()


def read_body(path: Path) -> None:
    """As scene=custom does."""
    read_obstacle(path, 1 / 30, 1)


READ: dict[str, Callable[[Path], object]] = {
    "cloth.h5": read_cloth, "recordings.h5": read_cloth, "old_recordings.h5": read_cloth, "garments.h5": read_garments,
    "animation.h5": read_animation,
    "law.ckpt": lambda path: load_law(str(path), SILK), "table.npz": read_baked,
    "estimates.json": lambda path: _estimates(str(path)), "walk.bvh": load_bvh,
    "body.obj": read_body, "body.ply": read_body, "body.glb": read_body, "body.npz": read_body,
}  # fmt: skip
"""How each format is read."""
BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 0 -1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -1 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.033
0 1 0 0 0 0 0 0 0
0 1 0 5 0 0 5 0 0
"""


def whole(folder: Path) -> dict[str, Path]:
    """A valid file of each format."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {name: folder / name for name in READ}
    write_swaying(found["cloth.h5"])
    as_version_1(write_recordings(found["recordings.h5"]), found["old_recordings.h5"])
    garments.write(found["garments.h5"])
    animations.write(found["animation.h5"], animations.header())
    found["law.ckpt"].write_bytes((SHIPPED / "eunet_hinge.ckpt").read_bytes())
    found["table.npz"].write_bytes((SHIPPED / "eunet_hinge_silk.npz").read_bytes())
    found["estimates.json"].write_bytes((SHIPPED / "est_garments.json").read_bytes())
    found["walk.bvh"].write_text(BVH)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    for kind in ("obj", "ply", "glb"):
        ball.export(found[f"body.{kind}"])
    np.savez(found["body.npz"], faces=ball.faces, positions=np.asarray(ball.vertices)[None], fps=30.0)
    return found


def write_recordings(path: Path) -> GarmentFile:
    """Two sequences of a piece of cloth whose vertices have masses of their own."""
    known = dict.fromkeys(RECORDED_MATERIAL, 1.0)
    about = trajectories.header(format=RECORDINGS, source="recorded", materials={"silk": known, "denim": known})
    garment = StoredGarment("sheet", "", MESH.rest_positions, MESH.faces, np.array([0, 3]), np.linspace(0.1, 0.2, 16))
    with data_writer(path, about) as writer:
        for sequence in trajectories.sequences(count=2):
            writer.add(Part(None, garment, replace(sequence, motion="flag.npz", mass_per_vertex=0.15)))
    return open_trajectories(path)


TEXTS, LUCKY = (".obj", ".bvh", ".json"), (("flipped",), ("flipped", "cut"))
"""Formats that may be cut off at the end of a line, and what may leave a file that is as good as before."""


def cases(files: dict[str, Path], folder: Path) -> Iterator[Case]:
    """Every damaged file, written when it is asked for; the next one takes its place."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, source in files.items():
        place = folder / name
        for damage, content in damaged_bytes(source.read_bytes()):
            place.write_bytes(content)
            lucky = damage.startswith(LUCKY[source.suffix in TEXTS])
            yield Case(f"{name}: {damage}", place, READ[name], must_fail=not lucky)
        write = {"h5": damaged_hdf5, "ckpt": damaged_ckpt, "npz": damaged_npz, "json": damaged_json}
        write |= dict.fromkeys(("bvh", "obj", "ply"), damaged_text)
        for damage in write.get(source.suffix[1:], lambda *_: ())(source, place):
            yield Case(f"{name}: {damage}", place, READ[name], must_fail=True)


def damaged_bytes(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Cut off, empty, another file, flipped."""
    yield from (("empty", b""), ("a text", b"no such format\n" * 9), ("zeros", bytes(len(content))))
    for share in (0.02, 0.3, 0.6, 0.9):
        yield f"cut at {share}", content[: int(share * len(content))]
    for place in np.random.default_rng(0).integers(0, len(content), 8):
        yield f"flipped {place}", content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :]


def damaged_hdf5(source: Path, place: Path) -> Iterator[str]:
    """Every attribute and dataset, one after the other."""
    with h5py.File(source) as file:
        holders, datasets = [""], []
        file.visititems(lambda name, item: (datasets if isinstance(item, h5py.Dataset) else holders).append(name))
        attributes = [(name, key) for name in holders for key in (file[name] if name else file).attrs]
        numbers = {(n, k): np.asarray((file[n] if n else file).attrs[k]).dtype.kind in "iuf" for n, k in attributes}
    for name, key in attributes:
        for what, value in {"removed": None, **VALUES}.items():
            if what in ("text", "empty") and not numbers[name, key]:
                continue
            with _copied(source, place) as file:
                attrs = (file[name] if name else file).attrs
                del attrs[key]
                if what != "removed":
                    attrs[key] = value
            if key not in UNUSED and not (key == "seed" and what == "negative"):
                yield f"{name or '/'}@{key} {what}"
    for name in datasets:
        for what, change in DATASETS.items():
            with _copied(source, place) as file:
                damaged = change(file, name, place.with_suffix(".raw")) is not False
            if damaged:
                yield f"{name} {what}"


UNUSED = ("meaning", "material", "first", "materials", "motion", "shape", "style", "quality", "attempts",
          "areal_density")  # fmt: skip
"""Attributes that only people read."""


def _copied(source: Path, place: Path) -> h5py.File:
    place.write_bytes(source.read_bytes())
    return h5py.File(place, "r+")


def _replaced(file: h5py.File, name: str, **settings: object) -> None:
    attrs = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, **settings).attrs.update(attrs)


def _filled(value: float) -> Callable[[h5py.File, str, Path], bool | None]:
    def change(file: h5py.File, name: str, _: Path) -> bool | None:
        values = file[name][()]
        whole_number = values.dtype.kind in "iu"
        if not values.size or values.dtype == bool or (whole_number and not np.isfinite(value)):
            return False
        # An animation may hold huge numbers: of a simulator that diverged.
        if name.startswith("numbers/") or ((name.endswith(("attempts", "v")) or name == "x") and np.isfinite(value)):
            return False
        values[(-1,) * values.ndim] = min(10**6, np.iinfo(values.dtype).max) if whole_number else value
        file[name][()] = values
        return None

    return change


def _external(file: h5py.File, name: str, beside: Path) -> None:
    values = file[name][()]
    beside.write_bytes(values.tobytes())
    _replaced(
        file, name, shape=values.shape, dtype=values.dtype, external=[(str(beside), 0, h5py.h5f.UNLIMITED)]
    )


def _linked(file: h5py.File, name: str, beside: Path) -> None:
    with h5py.File(beside, "w") as other:
        file.copy(name, other, "data")
    del file[name]
    file[name] = h5py.ExternalLink(str(beside), "data")


def _virtual(file: h5py.File, name: str, beside: Path) -> None:
    values = file[name][()]
    with h5py.File(beside, "w") as other:
        other["data"] = values
    layout = h5py.VirtualLayout(values.shape, values.dtype)
    layout[...] = h5py.VirtualSource(str(beside), "data", values.shape)
    attrs = dict(file[name].attrs)
    del file[name]
    file.create_virtual_dataset(name, layout).attrs.update(attrs)


def _grouped(file: h5py.File, name: str, _: Path) -> None:
    del file[name]
    file.create_group(name)["loop"] = file["/"]


def _huge(file: h5py.File, name: str, _: Path) -> None:
    shape = (10**9, *file[name].shape[1:]) if file[name].ndim else (10**9,)
    _replaced(file, name, shape=shape, dtype=file[name].dtype, chunks=(1, *shape[1:]))


OPTIONAL = ("twin", "/00000/positions", "/00003/positions", "garments/sheet/mass")
"""What a sequence of garments need not have."""
DATASETS: dict[str, Callable[[h5py.File, str, Path], bool | None]] = {
    "removed": lambda file, name, _: False if name.endswith(OPTIONAL) else file.__delitem__(name),
    "text": lambda file, name, _: _replaced(file, name, data="word"),
    "shape": lambda file, name, _: _replaced(file, name, data=np.ones((2, 3, 5, 7, 1))),
    "empty": lambda file, name, _: False if "pinned" in name else _replaced(file, name, shape=(0,), dtype="f4"),
    "nan": _filled(np.nan), "inf": _filled(np.inf), "huge value": _filled(1e30),
    "external": _external, "link": _linked, "virtual": _virtual, "group": _grouped, "huge": _huge,
}  # fmt: skip
"""What becomes of a dataset; False where the damage is none."""


def damaged_ckpt(source: Path, place: Path) -> Iterator[str]:
    """Every field of what a checkpoint says of itself, and some tensors of the network."""
    content = torch.load(source, weights_only=True)
    keys = [("state_dict",), ("drape",), *(("drape", key) for key in content["drape"])]
    keys += [("drape", "config", key) for key in ("model", "material", "datamodule")]
    keys += [("drape", "config", "model", key) for key in content["drape"]["config"]["model"]]
    keys += [("drape", "config", "model", "potential", key) for key in content["drape"]["config"]["model"]["potential"]]
    keys += [("drape", "config", "datamodule", "attribute_scales")]
    keys += [("drape", "example", key) for key in content["drape"]["example"]]
    keys += [("drape", "example", "window", key) for key in content["drape"]["example"]["window"]]
    keys += [("state_dict", key) for key in list(content["state_dict"])[:4]]
    for path in keys:
        for what, value in {"removed": None, "none": None, "text": "word", "nan": float("nan"), "list": [1]}.items():
            if path[-1] == "versions" or (what == "none" and path[-1] in ("timing", "dissipation")):
                continue
            changed = copy.deepcopy(content)
            holder = changed
            for key in path[:-1]:
                holder = holder[key]
            if what == "removed":
                del holder[path[-1]]
            elif what == "nan" and isinstance(holder[path[-1]], torch.Tensor) and holder[path[-1]].is_floating_point():
                holder[path[-1]].flatten()[0] = value
            else:
                holder[path[-1]] = value
            torch.save(changed, place)
            yield f"{'.'.join(path)} {what}"


def damaged_npz(source: Path, place: Path) -> Iterator[str]:
    """Every array, with the digest that its author would write; every value of a table's own description."""
    with np.load(source) as file:
        arrays = {name: file[name] for name in file.files}
    signed = arrays.pop("digest", None) is not None
    for name, array in arrays.items():
        changes = {"removed": None, "text": np.array("word"), "shape": np.ones((2, 3, 5, 7)), "empty": np.zeros(0)}
        if array.dtype.kind == "f":
            changes |= {what: _with(array, value) for what, value in (("nan", np.nan), ("inf", np.inf), ("huge", 1e30))}
        if array.dtype.kind == "i":
            changes |= {"negative": _with(array, -5), "large": _with(array, 10**6)}
        changes["objects"] = np.array([None, {}], dtype=object)
        for what, value in changes.items():
            _write_npz(place, {k: v for k, v in (arrays | {name: value}).items() if v is not None}, signed)
            if not (name == "fps" and what == "removed"):
                yield f"{name} {what}"
    for path, what, text in damaged_tree(json.loads(str(arrays["content"])) if signed else {}):
        _write_npz(place, arrays | {"content": np.array(text)}, signed)
        if path[0] != "certificate" or path[1:] in ((), ("energy",), ("force",), ("constants",)):
            yield f"content.{'.'.join(map(str, path))} {what}"
    if signed:
        _write_npz(place, arrays | {"table": 1.01 * arrays["table"]}, signed)
        yield "table 1 % stiffer"
        for node in ((0, 3, 3), (0, 60, 30), (1, 30, 40), (1, 45, 12)):
            bumped = arrays["table"].copy()
            bumped[node] *= 1.01
            _write_npz(place, arrays | {"table": bumped}, signed)
            yield f"table with a bump at {node}"


def _with(array: np.ndarray, value: float) -> np.ndarray:
    changed = array.copy()
    changed[(0,) * array.ndim] = value
    return changed


def _write_npz(place: Path, arrays: dict[str, np.ndarray], signed: bool) -> None:
    if signed and not any(array.dtype == object for array in arrays.values()):
        arrays = arrays | {"digest": np.array(_digest(arrays))}
    np.savez_compressed(place, **arrays)


def damaged_json(source: Path, place: Path) -> Iterator[str]:
    """Every value."""
    for path, what, text in damaged_tree(json.loads(source.read_text())):
        place.write_text(text)
        if path[0] == "estimates":
            yield f"{'.'.join(map(str, path))} {what}"


def damaged_tree(tree: dict) -> Iterator[tuple[tuple, str, str]]:
    """Path, damage, and the JSON of the tree with one value damaged."""
    paths = [()]
    while paths:
        path = paths.pop()
        holder = tree
        for key in path:
            holder = holder[key]
        for key in holder:
            if isinstance(holder[key], dict):
                paths.append((*path, key))
            texts = isinstance(holder[key], str)
            for what, value in {"null": None, "text": "word", "nan": np.nan, "negative": -1.0, "list": [[]]}.items():
                if (texts and what == "text") or (key == "first" and what == "negative"):
                    continue
                if key == "areal_density" and what == "null":
                    continue
                changed = copy.deepcopy(tree)
                inner = changed
                for step in path:
                    inner = inner[step]
                inner[key] = value
                yield (*path, key), what, json.dumps(changed)


def damaged_text(source: Path, place: Path) -> Iterator[str]:
    """Lines left out and numbers made nonsense, in formats that are text; of every mesh: without any size."""
    if source.suffix == ".ply":
        mesh = trimesh.load(source, process=False)
        mesh.vertices = 0 * mesh.vertices
        mesh.export(place)
        yield "no size"
        return
    lines = source.read_text().splitlines()
    for number, line in enumerate(lines):
        words = line.split()
        if not any(word.lstrip("-").replace(".", "").isdigit() for word in words) or (number > 8 and len(lines) > 60):
            continue
        for what in ("word", "nan", "1e999", ""):
            place.write_text("\n".join([*lines[:number], " ".join([*words[:-1], what]), *lines[number + 1 :]]) + "\n")
            yield f"line {number + 1} ends in {what!r}"
    if source.suffix == ".obj":
        place.write_text("\n".join("v 0 0 0" if line.startswith("v ") else line for line in lines))
        yield "no size"
        place.write_text("\n".join("f 1 2 999" if line.startswith("f ") else line for line in lines))
        yield "indices of no vertex"


class Score(NamedTuple):
    """What became of each file."""

    sentences: list[str]
    tracebacks: list[str]
    accepted: list[str]


def attack(folder: Path, every: int = 1) -> Score:
    """Read one of ``every`` damaged files."""
    score, files = Score([], [], []), whole(folder / "whole")
    for name, path in files.items():
        READ[name](path)
    for number, case in enumerate(cases(files, folder / "damaged")):
        if number % every:
            continue
        try:
            case.read(case.path)
        except DrapeError as error:
            score.sentences.append(f"{case.name}: {error}")
        except Exception as error:
            score.tracebacks.append(f"{case.name}: {type(error).__name__}: {str(error)[:150]}")
        else:
            if case.must_fail:
                score.accepted.append(case.name)
    return score


def main() -> None:
    """Print the score."""
    resource.setrlimit(resource.RLIMIT_AS, (12 * 2**30,) * 2)  # a file that asks for all memory there is
    with tempfile.TemporaryDirectory() as folder:
        score = attack(Path(folder), int(sys.argv[1]) if len(sys.argv) > 1 else 1)
    for name in ("tracebacks", "accepted"):
        print(f"--- {name}", *getattr(score, name), sep="\n")
    print("--- formats", *collections.Counter(line.split(":")[0] for line in score.sentences).items())
    print(f"{len(score.sentences)} sentences, {len(score.tracebacks)} tracebacks, {len(score.accepted)} accepted")


if __name__ == "__main__":
    main()
