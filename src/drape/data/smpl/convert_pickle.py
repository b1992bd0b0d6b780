"""Convert SMPL models and VTO motions from pickles to plain arrays, once: ``python -m drape.data.smpl.convert_pickle``.

SMPL's models and the motions of VTO and HOOD are distributed as pickles. Loading a pickle runs whatever program stands
in it, so nothing else in this package reads one: this command does it once, by itself, in a process that does nothing
else, and leaves an ``.npz`` of plain arrays. It admits numpy arrays, numbers, strings and containers, reads the arrays
out of chumpy's and scipy's objects without having these classes, and refuses a file that names anything else
(:mod:`drape.data.smpl.plain_unpickler`). No part of a pickle is ever called, whoever made it.

Examples:
    python -m drape.data.smpl.convert_pickle model_f.pkl data/smpl/female.npz
    python -m drape.data.smpl.convert_pickle vto_dataset/tshirt/simulations data/vto
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drape.data.smpl.plain_unpickler import read_plain_pickle
from drape.data.whole_file import whole_file
from drape.errors import DrapeError

MODEL = {
    "v_templ": "rest_positions",
    "f": "faces",
    "shapedirs": "shape_directions",
    "posedirs": "pose_directions",
    "J_regressor": "joint_regressor",
    "weights": "weights",
    "kintree_table": "parents",
}
"""SMPL's names, of one of them the beginning, and ours."""
MOTIONS = ({"pose": "poses", "translation": "translation", "shape": "shape"},
           {"transl": "translation", "betas": "shape", "global_orient": "", "body_pose": ""})  # fmt: skip
"""Names of VTO's motions and of HOOD's, and ours."""


def convert(source: Path, target: Path) -> str:
    """Convert one pickle to the npz ``target``; returns what it is: ``model`` or ``motion``.

    Raises:
        DrapeError: neither of them, or see :func:`read_plain_pickle`.
    """
    found = read_plain_pickle(source)
    kind, arrays = "model", _model(found)
    if arrays is None:
        kind, arrays = "motion", _motion(found)
    if arrays is None:
        raise DrapeError(
            f"{source}: found {', '.join(sorted(found)) or 'nothing'}; expected an SMPL model "
            f"({', '.join(MODEL)}...) or a motion ({'; or '.join(', '.join(names) for names in MOTIONS)})"
        )
    for name, array in arrays.items():
        if array.dtype.kind not in "iuf":
            raise DrapeError(f"{source}: {name}: found {array.dtype}; expected an array of numbers")
    with whole_file(target) as temporary:
        np.savez(temporary, **arrays)
    return kind


def _model(found: Mapping[str, object]) -> dict[str, np.ndarray] | None:
    arrays = {}
    for beginning, name in MODEL.items():
        keys = [key for key in found if (key[:7] if name == "rest_positions" else key) == beginning]
        if not keys:
            return None
        arrays[name] = np.asarray(found[keys[0]])
    arrays["faces"] = arrays["faces"].astype(np.int64)
    parents = arrays["parents"].astype(np.int64).reshape(-1, arrays["parents"].shape[-1])[0]
    arrays["parents"] = np.where(np.arange(len(parents)) == 0, -1, parents)  # the root's is -1, wrapped around
    return arrays


def _motion(found: Mapping[str, object]) -> dict[str, np.ndarray] | None:
    for names in MOTIONS:
        if names.keys() <= found.keys():
            arrays = {ours: np.asarray(found[theirs]) for theirs, ours in names.items() if ours}
            if "poses" not in arrays:
                arrays["poses"] = _all_joints(np.asarray(found["global_orient"]), np.asarray(found["body_pose"]))
            return arrays
    return None


def _all_joints(root: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.concatenate([root.reshape(-1, 3), others.reshape(-1, 69)], axis=1)


def main(arguments: list[str]) -> int:
    """The command line; returns the exit status: 2 where something was left out."""
    if len(arguments) != 2:
        print(__doc__)
        return 2
    source, target = Path(arguments[0]), Path(arguments[1])
    files = {source: target}
    if source.is_dir():
        found = sorted(source.rglob("*.pkl"))
        files = {file: (target / file.relative_to(source)).with_suffix(".npz") for file in found}
    if not files:
        print(f"{source}: found no .pkl file in this folder", file=sys.stderr)
    left_out = 0
    for file, place in files.items():
        try:
            print(f"{file} -> {place}: {convert(file, place)}")
        except DrapeError as error:
            print(f"left out: {error}", file=sys.stderr)
            left_out += 1
    return 2 if left_out or not files else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
