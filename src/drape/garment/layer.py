"""A body with a garment on it, as one solid: the next garment is worn over both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.garment.figure_like import Body
from drape.garment.kinds import Pattern


@dataclass(frozen=True, eq=False)
class Layer:
    """The union of a solid and of all that a garment over it encloses: ``min(d, max(field(d), -ends))`` [m].

    ``field`` and ``ends`` are those of the garment's pattern, exact to first order at its cloth.
    """

    inner: Body
    pattern: Pattern

    def signed_distance(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Distance to what is worn, or to the body where that is nearer; negative inside [m]."""
        distance = self.inner.signed_distance(points)
        enclosed = np.maximum(self.pattern.field(points, distance), -self.pattern.ends(points))
        return np.minimum(distance, enclosed)
