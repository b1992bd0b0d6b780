"""Convert sequences of another data set one by one into one file: resumable, and what cannot be read is left out."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import yaml
from tqdm import tqdm

from drape.data.difference import refuse_difference
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer
from drape.data.parts_folder import OTHERWISE, claimed, parts_of
from drape.data.stored_part import Header, Part
from drape.errors import DrapeError

SHOWN = 20
"""Sequences that a sentence names; the file's config has all of them."""


@dataclass(frozen=True)
class Conversion:
    """Result of a conversion."""

    path: Path
    converted: int
    """Sequences in the file."""
    made: bool
    """The file was written now, and not there already."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Sequence -> why it is not in the file."""

    def refuse_left_out(self) -> None:
        """Raise if the file is not complete.

        Raises:
            DrapeError: the sequences that were left out, each with its reason.
        """
        if self.left_out:
            raise DrapeError(
                f"{self.path}: holds {self.converted} sequences; {len(self.left_out)} were left out; the same command "
                f"tries them again:{_listed(self.left_out)}"
            )


def frame_range(frames: list) -> tuple[int, int]:
    """The first frame and the end (exclusive) that the config asks for.

    Raises:
        DrapeError: anything but two numbers in this order.
    """
    if len(frames) != 2 or not all(isinstance(number, int) for number in frames) or not 0 <= frames[0] < frames[1]:
        raise DrapeError(f"data.frames: found {frames}; expected [first, end], such as [10, 90]")
    return frames[0], frames[1]


def convert(
    path: Path, config: Mapping, header: Header, names: Iterable[str], read: Callable[[str], Part]
) -> Conversion:
    """Convert sequences ``names``, each made by ``read``, into the file ``path``; ``config`` is what determines them.

    Sequences that are done wait as files of their own in ``<path>.parts/``, so that after a kill at any moment the same
    call goes on. Where ``read`` raises a DrapeError, the sequence is left out and the others go on. Where the file is
    there already, those that were left out are tried again.

    Raises:
        DrapeError: no sequence at all, none that can be converted, another data set in the way, a full disk.
    """
    names, config = list(names), dict(config)
    if not names:
        raise DrapeError(f"{path}: found no sequence to convert; expected at least one; see data.root and its lists")
    there = _there(path, config)
    parts = parts_of(path)
    try:
        with claimed(parts, config):
            wanted = [name for name in names if there is None or name not in there.names]
            left_out = _convert_parts(parts, header, wanted, read)
            new = [name for name in wanted if name not in left_out]
            if new:
                full = replace(header, config=yaml.safe_dump({**config, "left_out": left_out}, sort_keys=False))
                _pack(path, full, there, parts, new)
            shutil.rmtree(parts, ignore_errors=True)
    except OSError as error:
        raise DrapeError(
            f"{path}: {error}; sequences that are done are kept in {parts}: make room or set the permissions, then run "
            "the same command again"
        ) from error
    converted = len(new) + (0 if there is None else len(there.names))
    if converted == 0:
        raise DrapeError(f"{path}: none of {len(names)} sequences can be converted:{_listed(left_out)}")
    return Conversion(path, converted, bool(new), left_out)


def _there(path: Path, config: Mapping) -> GarmentFile | None:
    """The file that an earlier call made."""
    if not path.exists():
        return None
    file = GarmentFile(path)
    made = yaml.safe_load(file.attribute("config")) or {}
    made.pop("left_out", None)
    refuse_difference(made, config, path, OTHERWISE)
    return file


def _convert_parts(
    parts: Path, header: Header, names: list[str], read: Callable[[str], Part]
) -> dict[str, str]:
    """Make the parts that are missing; returns what was left out, and why."""
    left_out = {}
    missing = [name for name in names if not _part(parts, name).exists()]
    with tqdm(total=len(names), initial=len(names) - len(missing), desc="converting", unit=" sequences") as bar:
        for name in missing:
            try:
                with data_writer(_part(parts, name), header) as writer:
                    writer.add(read(name))
            except DrapeError as error:
                left_out[name] = str(error)
                bar.set_postfix(left_out=len(left_out))
            bar.update()
    return left_out


def _pack(path: Path, header: Header, there: GarmentFile | None, parts: Path, names: list[str]) -> None:
    size = sum(_part(parts, name).stat().st_size for name in names) + (0 if there is None else path.stat().st_size)
    with data_writer(path, header, size) as writer:
        if there is not None:
            for name in there.names:
                writer.add(there.part(name))
        for name in tqdm(names, desc="packing", unit=" sequences"):
            with GarmentFile(_part(parts, name)) as file:
                writer.add(file.part(name))


def _part(parts: Path, name: str) -> Path:
    return parts / f"{name}.h5"


def _listed(left_out: Mapping[str, str]) -> str:
    lines = [f"\n  {name}: {reason}" for name, reason in sorted(left_out.items())]
    more = f"\n  and {len(lines) - SHOWN} more" if len(lines) > SHOWN else ""
    return "".join(lines[:SHOWN]) + more
