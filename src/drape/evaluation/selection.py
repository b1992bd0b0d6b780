"""The sequences of a data set that are evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import scene_frames
from drape.errors import DrapeError


@dataclass(frozen=True)
class Selection:
    """The first ``sequences`` of a split whose garments are of ``kinds``, and so many ``frames`` of each; None: all.

    Raises:
        DrapeError: a number of sequences below 1.
    """

    split: str
    sequences: int | None = None
    kinds: Sequence[str] | None = None
    frames: int | None = None

    def __post_init__(self) -> None:
        if self.sequences is not None and self.sequences < 1:
            raise DrapeError(f"sequences: found {self.sequences}; expected a whole number from 1 on, or null for all")

    def of(self, file: GarmentFile) -> dict[str, int]:
        """Name of each chosen sequence -> frames to simulate.

        Raises:
            DrapeError: an unknown split or kind, nothing that is left, a sequence without recorded garment or with
                fewer frames than asked for.
        """
        kind_of = {name: file.sequence(name).kind for name in file.split(self.split)}
        known = ", ".join(dict.fromkeys(kind_of.values())) or "none, as it is empty"
        for kind in self.kinds or ():
            if kind not in kind_of.values():
                raise DrapeError(
                    f"kinds: {file.path}: found no {kind!r} in the split {self.split}; expected some of its kinds: "
                    f"{known}"
                )
        chosen = [name for name, kind in kind_of.items() if self.kinds is None or kind in self.kinds][: self.sequences]
        if not chosen:
            raise DrapeError(
                f"{file.path}: found no sequence in the split {self.split}; expected some to evaluate; choose another "
                "split or kinds, or generate a data set that has some"
            )
        return {name: scene_frames(file.sequence(name), self.frames) for name in chosen}
