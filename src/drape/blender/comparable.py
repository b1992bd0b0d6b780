"""Scenes that Blender's cloth would do the same, so that it can be compared with ours. Does not import bpy."""

from __future__ import annotations

import numpy as np

from drape.errors import DrapeError
from drape.scene.scene import Scene


def refuse_incomparable(scene: Scene, body: tuple[str, bool], pins: tuple[str, bool], expected: str) -> None:
    """Refuse a scene with what Blender's cloth would not do the same.

    ``body``, ``pins``: what of them is refused, and whether the scene has it; ``expected`` ends the sentence.

    Raises:
        DrapeError: what is in it.
    """
    reasons = [
        body,
        ("an external force", scene.external_force is not None),
        pins,
        ("vertices of different masses", float(np.ptp(scene.mass)) > 1e-9 * float(scene.mass.max())),
        ("a start in motion", bool(np.any(scene.initial.v))),
    ]
    found = [reason for reason, applies in reasons if applies]
    if found:
        raise DrapeError(f"scene {scene.name}: found {', '.join(found)}; expected {expected}")
