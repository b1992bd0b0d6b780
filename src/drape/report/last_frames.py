"""Last frames of animated test sequences below the recorded ones, as one PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.data.look import fabric_colour, upright
from drape.report.picture_sheet import Line, draw_pictures
from drape.report.raster import Surface, draw
from drape.scene.camera import Camera
from drape.scene.scene import Scene

SIZE = 260
"""Of a picture [pixels]."""
RECORDED = "recorded"


@dataclass(frozen=True, eq=False)
class LastFrames:
    """One recorded sequence at its end, and as energies have animated it."""

    scene: Scene
    """With the recorded frames."""
    animated: Mapping[str, Float[np.ndarray, "vertices 3"]]
    """Positions at the end [m] by name of the energy."""


def draw_last_frames(sequences: Sequence[LastFrames], path: Path) -> Path:
    """Draw a column for each of ``sequences``: recorded, then as each energy has it; returns ``path``.

    The camera is that of the recorded motion, so that places compare.
    """
    columns = [_pictures(sequence) for sequence in sequences]
    times = [sequence.scene.frames * sequence.scene.dt for sequence in sequences]
    lines = [
        Line([column[name] for column in columns], times if name == RECORDED else (), name) for name in columns[0]
    ]
    return draw_pictures(lines, path)


def _pictures(sequence: LastFrames) -> dict[str, Float[np.ndarray, "height width 3"]]:
    scene = sequence.scene
    reference = np.asarray(scene.reference)
    rotation, colour = upright(scene.gravity), fabric_colour(scene.material.name)
    camera = Camera.framing((x @ rotation.T for x in reference), 1.0)

    surfaces = {
        name: Surface(x @ rotation.T, scene.mesh.faces, colour)
        for name, x in {RECORDED: reference[-1], **sequence.animated}.items()
    }
    return {name: draw([surface], camera, SIZE, SIZE) for name, surface in surfaces.items()}
