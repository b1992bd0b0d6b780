"""Compiled kernels: the process that compiles them and those that read the compiled form compute the same."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.integration.conftest import ROOT

ENERGIES = """
import hashlib
import numpy as np
from drape.energy.baked_file import read_baked
from drape.energy.baked_kernel import _table
from drape.energy.baked_kernel_law import potentials
from drape.energy.baked_kernel_vectors import BLOCK
law = read_baked("src/drape/checkpoints/eunet_stable_silk.npz").double()
q = np.random.default_rng(0).normal(0.0, 0.05, (40, 4, BLOCK))
found = potentials(q, np.full((40, BLOCK), 0.2), False, _table(law))
print(*(hashlib.sha256(each.tobytes()).hexdigest() for each in found))
"""


def test_reading_the_compiled_form_changes_no_bit(tmp_path):
    env = os.environ | {"PYTHONPATH": str(ROOT / "src"), "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run([sys.executable, "-c", ENERGIES], env=env, cwd=ROOT, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert list(tmp_path.rglob("*potentials*.nbc"))
    assert said[0].stdout == said[1].stdout != ""
