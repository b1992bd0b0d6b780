"""Learn the constitutive law of a fabric from the motion of one piece of cloth, and animate any garment with it.

The public names, for programs of your own; everything else may change without notice::

    config = drape.compose("animate", "scene=hanging", "fabric=cotton")
    scene, fabric = drape.instantiate(config.scene), drape.instantiate(config.energy)
    positions = drape.animate(scene, fabric)          # frames, vertices, 3 [m]
"""

import os
from importlib import import_module

__version__ = "0.1.0"

if "OMP_WAIT_POLICY" not in os.environ:
    # Threads of PyTorch that wait for each other spin for tens of microseconds and then sleep, instead of spinning for
    # milliseconds: beside other work a frame of 1081 vertices takes 111 instead of 310 ms, alone 28 instead of 27.
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")

PUBLIC = {
    "AnimationFile": "drape.data.animation_hdf5",
    "ClothMesh": "drape.geometry.mesh",
    "DrapeError": "drape.errors",
    "EUNet": "drape.energy.law.eunet",
    "GarmentFile": "drape.data.hdf5",
    "ImplicitSolver": "drape.simulators.solver.implicit",
    "IncrementalPotential": "drape.energy.incremental_potential",
    "Material": "drape.scene.material",
    "Scene": "drape.scene.scene",
    "State": "drape.scene.state",
    "animate": "drape.simulators.animate",
    "compose": "drape.config.compose",
    "instantiate": "drape.config.entry_point",
    "load_energy": "drape.energy.law.checkpoint",
    "open_trajectories": "drape.data.trajectories",
}
"""Module of each public name; loaded when it is asked for, as not all need torch."""
__all__ = [*PUBLIC, "__version__"]


def __getattr__(name: str) -> object:
    if name in PUBLIC:
        return getattr(import_module(PUBLIC[name]), name)
    raise AttributeError(f"module 'drape' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *PUBLIC])
