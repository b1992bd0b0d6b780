"""Compiled kernels: the process that compiles them and those that read the compiled form compute the same."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.integration.conftest import ROOT

ENERGIES = """
import hashlib
import numpy as np
import torch
from drape.energy.law.baked.file import read_baked
from drape.energy.terms.hinge_elastic import HingeEdges, HingeElastic
from drape.energy.terms.hinge_kernel import add_hessian, energies_and_forces
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
term = HingeElastic(read_baked("src/drape/checkpoints/eunet_hinge_silk.npz"), transfer=True)
mesh = MeshBatch.from_meshes([square_grid(1.0, 30)])
edges, tables = term._compiled(term.edges(mesh), mesh.rest_positions)
x = mesh.rest_positions.numpy() + np.random.default_rng(0).normal(0.0, 0.02, (900, 3))
data = np.zeros(78 * mesh.num_edges)
add_hessian(x, edges, tables, mesh.num_edges, data, np.arange(len(data), dtype=np.int32).reshape(-1, 78))
found = (*energies_and_forces(x, edges, tables), data)
print(*(hashlib.sha256(each.tobytes()).hexdigest() for each in found))
"""


def test_reading_the_compiled_form_changes_no_bit(tmp_path):
    env = os.environ | {"PYTHONPATH": str(ROOT / "src"), "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run([sys.executable, "-c", ENERGIES], env=env, cwd=ROOT, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    for function in ("energies_and_forces", "add_hessian"):
        assert list(tmp_path.rglob(f"*{function}*.nbc"))
    assert said[0].stdout == said[1].stdout != ""
