"""The edge sets that carry messages in each step of a graph network, as plain lists."""

from __future__ import annotations


def flat_schedule(steps: int) -> list[list[str]]:
    """MeshGraphNet: every step passes messages along the mesh and from the body."""
    return [["mesh", "body"] for _ in range(steps)]


def hood_schedule(repeats: int = 3) -> list[list[str]]:
    """HOOD's way down to the second coarse level and up again, each of its five stages ``repeats`` times.

    HOOD, section 3.2, and docs/sources.md, HOOD.

    Where the mesh rests, the body speaks to the vertices of the finest level in use only (``body@level``).
    """
    stages = [
        ["mesh", "coarse_1", "body"],
        ["coarse_1", "coarse_2", "body@1"],
        ["coarse_2", "body@2"],
        ["coarse_1", "coarse_2", "body@1"],
        ["mesh", "coarse_1", "body"],
    ]
    return [list(stage) for stage in stages for _ in range(repeats)]
