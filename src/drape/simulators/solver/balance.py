"""Unbalanced forces in weights, and from where on they are a frame that hangs in the air."""

from __future__ import annotations

import numpy as np

from drape.scene.scene import Scene

WITHOUT_GRAVITY = 9.81
"""Factor of masses where there is no gravity [m/s²]."""
BALANCED = 1e-3
"""Mean unbalanced force at which a step is done, in mean weights of a vertex, unless a tolerance is chosen."""
HANGING = 0.2
"""Mean unbalanced force above which a frame hangs in the air for want of iterations, in mean weights of a vertex.

Of 209 steps that ran out of 5 to 50 evaluations (the 3.6 m sheet on its sphere, the hanging 4.8 m sheet; also 16 and
300 times lighter), 102 ended more than ``0.1 g dt²`` from where 200 evaluations end, a tenth of what cloth falls in its
first frame. 100 of them had more than this, and 11 of the others. The largest force of a vertex says less (few stiff
edges make it hundreds of weights and move nobody: 69 of the others), and the median misses cloth of which less than
half hangs.
"""


def mean_weight(scene: Scene) -> float:
    """``m |g|`` of a free vertex [N]; without gravity ``m 9.81 m/s²``."""
    free = scene.mass if scene.pins is None else np.delete(scene.mass, scene.pins.vertices)
    return (float(np.linalg.norm(scene.gravity)) or WITHOUT_GRAVITY) * float(free.mean())
