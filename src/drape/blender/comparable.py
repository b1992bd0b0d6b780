"""Scenes that Blender's cloth would do the same, so that it can be compared with ours. Does not import bpy."""

from __future__ import annotations

import numpy as np

from drape.errors import DrapeError
from drape.scene.scene import Scene


def refuse_incomparable(scene: Scene, *further: tuple[str, bool], expected: str) -> None:
    """Refuse a scene with what Blender's cloth would not do the same.

    ``further``: what else is refused, and whether the scene has it; ``expected`` ends the sentence.

    Raises:
        DrapeError: what is in it.
    """
    reasons = [
        *further,
        ("an external force", scene.external_force is not None),
        ("vertices of different masses", float(np.ptp(scene.mass)) > 1e-9 * float(scene.mass.max())),
        ("a start in motion", bool(np.any(scene.initial.v))),
    ]
    found = [reason for reason, applies in reasons if applies]
    if found:
        raise DrapeError(f"scene {scene.name}: found {', '.join(found)}; expected {expected}")
