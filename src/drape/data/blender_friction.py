"""Coulomb friction of Blender's cloth: the coefficient μ of its number ``cloth_friction``, and the number of a μ.

Blender changes the velocity of cloth that touches a body by two impulses with equal factors (its ``collision.cc``):
the closing speed along the normal, and ``min(number / 100 · closing speed, |slip|)`` against the slip. So it is
Coulomb's friction, with

    ``μ = number / 100``

Measured with Blender 5.0.1 (``python src/benchmark.py measure=friction``): without air drag, a sheet on a slope φ of
large faces slides with ``g (sin φ - μ cos φ)`` from ``tan φ = μ`` on and rests below, and a body that moves away below
it takes it along with ``μ g``; within 0.001 of μ at 10 solver steps a frame, whatever the fabric, its mesh, the
distances of contact and ``damping``, with two or more collision iterations. Where it ceases to hold:

* Cloth that has sunk to 8/9 of the distance of contact is also held by impulses that push it out and do not rub: on
  large faces μ falls to 0.88 of the number after half a second.
* Cloth that slides over small faces is braked more, also at number 0: by 0.002 to 0.01 of its weight over edges of 10
  to 2.5 cm at 0.3 m/s, and by 0.03 at 2 m/s.
* With 20 solver steps a frame μ is 0.002 lower, with 30 by 0.007.
* Vertices below 0.03 kg are braked by something else: 0.01 kg by 0.1 of their weight.
"""

from __future__ import annotations

HIGHEST_NUMBER = 80.0
"""Blender takes no number above."""


def coefficient(number: float) -> float:
    """μ [1] of Blender's ``cloth_friction``, a number from 0 to 80."""
    return number / 100.0


def blender_number(coefficient: float) -> float:
    """Blender's ``cloth_friction`` of μ [1], from 0 to 0.8."""
    return coefficient * 100.0
