"""Tabulate the trained law of one fabric as splines: ``python src/bake.py checkpoint=... fabric=silk``."""

from __future__ import annotations

import hashlib
from pathlib import Path

from omegaconf import DictConfig

from drape import config as conf
from drape.energy.law.baked.baking import bake
from drape.energy.law.baked.file import save_baked
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.law.load_law import load_law
from drape.errors import DrapeError


@conf.main("bake")
def main(config: DictConfig) -> None:
    checkpoint, path = Path(config.checkpoint), Path(config.path)
    if path.suffix != ".npz":
        raise DrapeError(f"path: found {path}; expected a name that ends in .npz")
    fabric, resolution, bounds = (conf.instantiate(config[name]) for name in ("fabric", "table", "bounds"))
    law, _ = load_law(str(checkpoint), fabric)
    if not isinstance(law, NetworkHinges):
        raise DrapeError(
            f"{checkpoint}: found a law of the paper's (stretch, twist, bend); expected one of stretch and hinge, as "
            "model=eunet_hinge trains it; the paper's runs by its networks: energy=eunet energy.checkpoint=..."
        )
    sha256 = hashlib.sha256(checkpoint.read_bytes()).hexdigest()
    source = {"checkpoint": checkpoint.name, "sha256": sha256}
    baked = bake(law, resolution, fabric=fabric, **source)
    print(baked.certificate.text())
    baked.certificate.check(bounds)
    save_baked(baked, path)
    print(f"table: {path} ({path.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    main()
