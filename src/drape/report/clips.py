"""Short films and last pictures of animated garments, kept until their animation changes."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image
from tqdm import tqdm

from drape.data.animation_hdf5 import AnimationFile
from drape.data.hdf5 import GarmentFile
from drape.data.look import fabric_colour
from drape.data.recorded_scene import START
from drape.data.sequence import GarmentSequence
from drape.data.whole_file import whole_file
from drape.errors import DrapeError
from drape.evaluation.scored_sequence import UNREADABLE
from drape.report.garment_rows import GarmentRow
from drape.report.names import fingerprint, slug
from drape.report.stage import Stage, shown_frames

RECORDED = "recorded"
"""Label of what all others are compared with."""
STYLE = 1
"""Of the pictures; another number draws all of them anew."""
QUALITIES = (80, 60, 40, 20)
"""Of WebP, tried in this order until a clip is small enough."""
MOST_BYTES = 1_000_000
LAST_SHOWN = 900
"""Time for which a clip stays at its end [ms]."""


@dataclass(frozen=True)
class Lane:
    """One way to animate a sequence, as it is shown."""

    label: str
    clip: Path | None = None
    picture: Path | None = None
    """The last frame; the error in colours, except of the recorded garment."""
    problem: str = ""
    """A sentence where there is nothing to see."""
    scores: Mapping[str, float] = field(default_factory=dict)
    """``error_mm`` and ``collision_percent`` of the sequence."""


@dataclass(frozen=True)
class ShownSequence:
    """A sequence in motion: the recorded garment first, then the rows."""

    name: str
    kind: str
    fabric: str
    motion: str
    lanes: tuple[Lane, ...]

    @property
    def pictures(self) -> list[Lane]:
        """The lanes that have a picture of their last frame."""
        return [lane for lane in self.lanes if lane.picture is not None]


def show(rows: Sequence[GarmentRow], most: int, folder: Path, height: int) -> list[ShownSequence]:
    """Clips and pictures of ``most`` sequences that ``rows`` share, below ``folder``; drawn unless they are there.

    What cannot be read is a lane with a sentence. Of several seeds the first is shown.
    """
    names, data = one_of_each_kind(rows[0], most), rows[0].records[0].data
    shown = []
    with tqdm(total=len(names) * (1 + len(rows)), desc="clips", unit=" clips", leave=False) as bar:
        for name in names:
            try:
                sequence = GarmentFile(str(data["path"])).sequence(name)
                stage = _stage(sequence, height)
            except (DrapeError, OSError) as error:
                shown.append(ShownSequence(name, "", "", "", (Lane(RECORDED, problem=_sentence(error)),)))
                bar.update(1 + len(rows))
                continue
            frames = int(data["frames"][list(data["sequences"]).index(name)])
            lanes = [_recorded(sequence, stage, frames, folder / slug(name))]
            bar.update()
            for row in rows:
                lanes.append(_animated(row, sequence, stage, folder / slug(name)))
                bar.update()
            shown.append(ShownSequence(name, sequence.kind, sequence.fabric, sequence.motion, tuple(lanes)))
    return shown


def one_of_each_kind(row: GarmentRow, most: int) -> list[str]:
    """Names of at most ``most`` sequences of a row: the first of each kind of garment, then the second ones, ..."""
    kinds = {name: scores.get("kind", "") for name, scores in _scores(row.records[0].folder).items()}
    place: dict[str, tuple[int, str]] = {}
    for name in map(str, row.records[0].data["sequences"]):
        same = [other for other in place if kinds.get(other) == kinds.get(name)]
        place[name] = (len(same), name)
    return sorted(place, key=place.__getitem__)[:most]


def _stage(sequence: GarmentSequence, height: int) -> Stage:
    reference = sequence.positions[START:]
    return Stage(
        reference, sequence.file.dt, sequence.mesh.faces, sequence.body_faces, fabric_colour(sequence.fabric), height
    )


def _recorded(sequence: GarmentSequence, stage: Stage, frames: int, folder: Path) -> Lane:
    def draw(clip: Path, picture: Path) -> None:
        bodies = sequence.body_positions[START:]
        times = list(shown_frames(frames + 1, sequence.file.dt))
        film = [stage.picture(k, stage.reference[k], bodies[k]) for k in times]
        _save(film, sequence.file.dt * (times[1] - times[0] if len(times) > 1 else 1), clip)
        Image.fromarray(stage.picture(frames, stage.reference[frames], bodies[frames])).save(picture, quality=90)

    return _kept(RECORDED, (sequence.file.path,), (stage.height, frames), folder, draw)


def _animated(row: GarmentRow, sequence: GarmentSequence, stage: Stage, folder: Path) -> Lane:
    record = row.records[0]
    path = record.folder / "sequences" / f"{sequence.name}.h5"
    told = _scores(record.folder).get(sequence.name, {})
    scores: dict[str, float] = {name: float(told[name]) for name in ("error_mm", "collision_percent") if name in told}

    def draw(clip: Path, picture: Path) -> None:
        with AnimationFile(path) as file:
            x, dt = file.trajectory().x, file.header.dt
        if x.shape[1:] != stage.reference.shape[1:] or len(x) > len(stage.reference):
            raise DrapeError(
                f"{path}: found {len(x)} frames of {x.shape[1]} vertices; expected at most {len(stage.reference)} of "
                f"{stage.reference.shape[1]}, as {sequence.file.path} has them; evaluate again"
            )
        bodies = sequence.body_positions[START:]
        times = list(shown_frames(len(x), dt))
        film = [stage.picture(k, x[k], bodies[k]) for k in times]
        _save(film, dt * (times[1] - times[0] if len(times) > 1 else 1), clip)
        last = len(x) - 1
        Image.fromarray(stage.error_picture(last, x[last], bodies[last])).save(picture, quality=90)

    return _kept(row.label, (path, sequence.file.path), (stage.height,), folder, draw, scores)


def _kept(
    label: str,
    sources: Sequence[Path],
    settings: tuple,
    folder: Path,
    draw: Callable[[Path, Path], None],
    scores: Mapping[str, float] | None = None,
) -> Lane:
    """A lane whose files are drawn unless those of the same sources are there; older ones of its label go."""
    stem = slug(label)
    try:
        for path in sources:
            if not path.is_file():
                raise DrapeError(f"{path}: found no such file; expected the frames to be shown; evaluate again")
        found = [(str(path), path.stat().st_mtime_ns, path.stat().st_size) for path in sources]
        stamp = fingerprint((STYLE, label, found, settings), 10)
        clip, picture = folder / f"{stem}-{stamp}.webp", folder / f"{stem}-{stamp}-last.webp"
        if not (clip.is_file() and picture.is_file()):
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob("*.webp"):
                if re.fullmatch(re.escape(stem) + r"-[0-9a-f]{10}(-last)?\.webp", old.name):
                    old.unlink()
            draw(clip, picture)
    except (DrapeError, OSError) as error:
        return Lane(label, problem=_sentence(error), scores=scores or {})
    return Lane(label, clip, picture, scores=scores or {})


def _save(film: Sequence[UInt8[np.ndarray, "_ _ 4"]], seconds: float, path: Path) -> None:
    """An animated WebP without background that runs for ever, ``seconds`` a picture, of at most :data:`MOST_BYTES`."""
    pictures = [Image.fromarray(picture) for picture in film]
    durations = [round(1e3 * seconds)] * (len(pictures) - 1) + [LAST_SHOWN]
    for quality in QUALITIES:
        with whole_file(path) as temporary:
            pictures[0].save(
                temporary,
                save_all=True,
                append_images=pictures[1:],
                duration=durations,
                loop=0,
                quality=quality,
                method=3,
            )
        if path.stat().st_size <= MOST_BYTES:
            return


def _scores(folder: Path) -> dict[str, dict[str, str]]:
    """Rows of ``sequences.csv`` by the name of the sequence; nothing where it cannot be read."""
    try:
        with open(folder / "sequences.csv", newline="", encoding="utf-8") as file:
            return {row["sequence"]: row for row in csv.DictReader(file)}
    except UNREADABLE:
        return {}


def _sentence(error: Exception) -> str:
    return f"Nothing to show: {error}"
