"""Extremes: every frame is finite and says how it ended, and energy comes from nowhere in none of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf
from scipy import sparse

from drape.config import instantiate
from drape.config.entry_point import CONF
from drape.data.animation_hdf5 import AnimationFile, AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.linalg.factorisation import Factorisation
from drape.metrics.stability import Stability, energies, gain, stability
from drape.report.stability import STOPPED, document, draw, read, verdict
from drape.scene.state import State
from drape.simulators.rollout import COLUMNS, roll_out
from drape.simulators.simulator import Outcome

SMALL = ("scene=extreme", "scene.resolution=4", "scene.frames=4", "simulator.iterations=20")
CASES = (
    "fps 10", "fps 960", "edge 0.001", "edge 0.5", "mass 0.001", "mass 1000", "needles 1000", "pins 10", "far 10000",
    "stretch 0.01", "stretch 10", "scramble 1", "scramble 10", "folded 180", "collapsed 0", "collapsed 1", "speed 100",
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None):
        yield


def config_of(case: str, *overrides: str) -> DictConfig:
    return compose("animate", [*SMALL, f"scene.case={case}", *overrides])


def animated(config: DictConfig, path: Path) -> Stability:
    """As src/animate.py does it."""
    scene, fabric = instantiate(config.scene), instantiate(config.energy)
    potential = IncrementalPotential.for_scene(scene, fabric.terms)
    simulator = instantiate(config.simulator)(potential, scene, fabric.attributes)
    settings = {name: OmegaConf.to_container(config[name], resolve=True) for name in ("scene", "energy")}
    header = AnimationHeader.of_scene(scene, COLUMNS, OmegaConf.to_yaml(settings))
    with AnimationWriter(path, header) as writer:
        roll_out(simulator, scene, writer)
    with AnimationFile(path) as file:
        return stability(file, scene, fabric)


@pytest.mark.parametrize(("energy", "precision"), [("phys", "float32"), ("eunet_baked", "float64")])
@pytest.mark.parametrize("case", CASES)
def test_extremes_are_finite_and_gain_no_energy(case, energy, precision, tmp_path):
    config = config_of(case, f"energy={energy}", f"simulator.precision={precision}")
    result = animated(config, tmp_path / "animation.h5")
    assert result.is_finite
    assert result.outcomes.total() == 4
    assert Outcome.NOT_FINITE not in result.outcomes
    assert result.gain <= (1e-9 if precision == "float64" else 1e-5)


@pytest.mark.parametrize("case", ["fps 30", "stretch 10", "stretch 2", "mass 1000", "far 10000", "folded 90"])
def test_what_is_no_extreme_for_phys_converges(case, tmp_path):
    result = animated(config_of(case, "energy=phys", "simulator.iterations=200"), tmp_path / "animation.h5")
    assert set(result.outcomes) == {Outcome.CONVERGED}
    assert result.residual <= 1e-3 * (1 + 1e-9)
    assert result.drift is None or result.drift < 1e-12


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_cloth_folded_onto_itself_opens_to_one_side(precision, tmp_path):
    """Along a line of vertices, by half a turn more or less what rounding leaves: to the same side, all along it."""
    angles = 180.0, -180.0, 180.0 + 1e-7, 180.0 - 1e-7
    changes = ("energy=eunet_baked", "scene.resolution=5", "simulator.iterations=99")
    changes = (*changes, f"simulator.precision={precision}")
    ends = [animated(config_of(f"folded {angle}", *changes), tmp_path / f"{angle}.h5") for angle in angles]
    for end in ends:
        assert set(end.outcomes) == {Outcome.CONVERGED}
        np.testing.assert_allclose(end.x, ends[0].x, atol=1e-3)
    assert np.ptp(ends[0].x[:, 2]) > 0.1


def test_beyond_all_numbers_the_cloth_stays_and_says_so(tmp_path):
    result = animated(config_of("scramble 1e100", "energy=phys"), tmp_path / "a.h5")
    assert set(result.outcomes) == {Outcome.NOT_FINITE}
    assert verdict(result) == "not finite, or stopped"


def test_a_search_out_of_evaluations_is_no_lack_of_precision(tmp_path):
    """Whatever the maximum: in float64, nothing but it stops a cloth that is far from the minimum."""
    for iterations in range(3, 12, 2):
        config = config_of("stretch 0.01", "energy=phys", "scene.frames=2", f"simulator.iterations={iterations}")
        assert Outcome.PRECISION not in animated(config, tmp_path / f"{iterations}.h5").outcomes


@pytest.mark.parametrize("iterations", [3, 200])
@pytest.mark.parametrize("case", ["stretch 3", "fps 30"])
def test_at_no_number_of_iterations_is_there_energy_from_nowhere(case, iterations, tmp_path):
    """Converged steps of implicit Euler gain 2 % here, where the cloth goes through its own folds; others a third."""
    changes = ("energy=phys", "scene.frames=15", "scene.resolution=4", f"simulator.iterations={iterations}")
    result = animated(config_of(case, *changes), tmp_path / "animation.h5")
    assert result.gain < 1e-12
    assert result.drift is None or result.drift < 1e-12


def test_energy_is_that_of_a_falling_cloth():
    config = config_of("fps 30", "energy=phys")
    scene, fabric = instantiate(config.scene), instantiate(config.energy)
    state = State(scene.initial.x - [0.0, 0.0, 2.0], np.full_like(scene.initial.x, 3.0))
    kinetic, stored, potential = next(iter(energies(scene, fabric, [state])))
    mass = scene.mass.sum()
    assert (kinetic, potential) == pytest.approx((0.5 * mass * 27.0, -mass * 9.81 * 2.0))
    assert abs(stored) < 1e-9
    stretched = State.at_rest(2.0 * scene.initial.x)
    assert next(iter(energies(scene, fabric, [stretched])))[1] > 1.0


def test_gain_counts_every_rise_above_the_past():
    assert gain(np.array([4.0, 3.0, 1.0]), 4.0) == 0.0
    assert gain(np.array([4.0, 1.0, 1.5, 1.25, 2.0]), 4.0) == 0.25
    assert gain(np.array([0.0, 0.0]), 0.0) == 0.0


def test_work_from_outside_is_refused(tmp_path):
    config = compose("animate", ["scene=sphere", "energy=phys", "scene.frames=1", "scene.resolution=5"])
    with pytest.raises(DrapeError, match="found a body or moving pins; expected a scene where nobody does work"):
        animated(config, tmp_path / "animation.h5")


@pytest.mark.parametrize("case", ["squash 3", "stretch", "stretch a", "stretch inf", "collapsed 7"])
def test_unknown_cases_are_refused(case):
    with pytest.raises(DrapeError, match=r"scene\.case: found '"):
        instantiate(config_of(case).scene)


def _stretched(precision: str) -> DictConfig:
    return config_of("stretch 2", "energy=phys", f"simulator.precision={precision}", "simulator.iterations=200")


def test_the_report_has_every_run_and_why_one_stopped(tmp_path):
    for energy, precision in (("phys", "float64"), ("phys", "float32"), ("eunet_baked", "float64")):
        folder = tmp_path / "stretch 2" / energy / precision
        (folder / ".hydra").mkdir(parents=True)
        if energy == "phys":
            animated(_stretched(precision), folder / "animation.h5")
        else:
            (folder / STOPPED).write_text("ValueError: why\n")
    found = read(tmp_path)
    assert set(found) == {("stretch 2", "phys", "float64"), ("stretch 2", "phys", "float32"),
                          ("stretch 2", "eunet_baked", "float64")}  # fmt: skip
    text = document(found)
    assert "| stretch 2 | 4/4 |" in text
    assert "ValueError: why / not run" in text
    assert verdict(found["stretch 2", "phys", "float64"]) == "all frames converged"
    assert verdict("ValueError: why") == "not finite, or stopped"
    assert draw(found, tmp_path / "stability.png").stat().st_size > 5000


@pytest.mark.parametrize("noise", [0.0, 1e-15, 1e-7])
def test_matrices_that_rounding_has_left_indefinite_are_factorised(noise):
    """A sum of squares over sixteen orders of magnitude, disturbed as rounding disturbs it."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(30, 30)) * 10.0 ** rng.uniform(-8, 8, 30)[:, None]
    matrix = rows.T @ rows
    size = np.sqrt(matrix.diagonal())
    matrix += noise * np.outer(size, size) * np.tril(rng.normal(size=matrix.shape), -1)
    matrix = np.tril(matrix) + np.tril(matrix, -1).T
    factors = Factorisation()
    factors.factorise(sparse.csr_array(np.triu(matrix)))
    right = rng.normal(size=30)
    solution = factors.solve(right)
    assert np.isfinite(solution).all()
    assert right @ solution > 0, "a direction of descent"
    factors.close()


def test_a_good_matrix_is_not_touched():
    matrix = sparse.csr_array(np.diag([1.0, 2.0, 4.0]) + 0.1)
    factors = Factorisation()
    factors.factorise(sparse.csr_array(sparse.triu(matrix)))
    np.testing.assert_allclose(matrix @ factors.solve(np.ones(3)), np.ones(3), rtol=1e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_what_no_rounding_explains_is_refused(bad):
    with pytest.raises(ArithmeticError, match="not finite|not positive definite"):
        Factorisation().factorise(sparse.csr_array(np.diag([1.0, bad])))
