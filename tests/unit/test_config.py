"""Every kind of mistake in a config is found before anything is built, and told in a sentence."""

from __future__ import annotations

import errno
import os
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from drape.config import check_ablation, check_config, entry_point, instantiate, main, set_statistics
from drape.config.accepts import accepts
from drape.config.target import locate
from drape.errors import DrapeError

HERE = __name__


class Part:
    pass


class Speed(Part):
    def __init__(self, sigma: float = 1.0):
        if sigma == 12:
            raise DrapeError("no noise at all")
        if sigma > 10:
            raise ValueError(f"sigma is {sigma}; expected a length below 10")
        self.sigma = sigma


class Rate(Part):
    def __init__(self, factor: float):
        self.factor = factor


class Stretch:
    pass


class Net:
    def __init__(
        self,
        width: int,
        rate: float = 0.1,
        bias: bool = True,
        inertia: Literal["predicted", "kinetic"] = "predicted",
        sizes: list[int] | None = None,
        name: str = "net",
        dissipation: Part | None = None,
    ):
        self.width, self.dissipation, self.sizes = width, dissipation, sizes
        self.rest = (rate, bias, inertia, name)


PAGES = {
    "app.yaml": """
        defaults: [model: two_parts, loss: all, scale: small, ablation: none, _self_,
                   {override hydra/job_logging: none}, {override hydra/hydra_logging: none}]
        seed: 0
        hydra:
          run: {dir: "RUNS/${joined:ablation}"}
          sweep: {dir: "RUNS/${joined:scale}", subdir: "${joined:ablation}"}
    """,
    "model/two_parts.yaml": """
        defaults: [dissipation: speed]
        _target_: HERE.Net
        width: ${scale.width}
    """,
    "model/one_part.yaml": "{_target_: HERE.Net, width: 8}",
    "model/dissipation/speed.yaml": "{_target_: HERE.Speed, sigma: 1.0}",
    "model/dissipation/zero.yaml": "# @package _global_",
    "model/dissipation/rate.yaml": "{_target_: HERE.Rate, factor: 2.0}",
    "scale/small.yaml": "{width: 8, name: small}",
    "loss/all.yaml": "balance: {_target_: HERE.Speed}",
    "ablation/none.yaml": "# @package _global_",
    "ablation/no_dissipation.yaml": "# @package _global_\ndefaults: [{override /model/dissipation: zero}]",
    "ablation/other_dissipation.yaml": "# @package _global_\ndefaults: [{override /model/dissipation: rate}]",
    "ablation/narrow.yaml": "# @package _global_\nmodel: {width: 4}",
    "ablation/misspelt.yaml": "# @package _global_\nmodel: {disipation: null}",
    "ablation/inert.yaml": "# @package _global_\nseed: 0",
}


@pytest.fixture
def conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small tree of config groups, used instead of the project's own."""
    folder = tmp_path / "conf"
    for name, text in PAGES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        text = "\n".join(line.removeprefix(" " * 8) for line in text.strip("\n").splitlines())
        (folder / name).write_text(text.replace("HERE", HERE).replace("RUNS", str(tmp_path / "runs")))
    monkeypatch.setattr(entry_point, "CONF", folder)
    monkeypatch.setattr("drape.config.check.CONF", folder)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    return folder


@pytest.fixture
def run(conf, monkeypatch):
    """Run a function of the config as the entry point ``app`` would, with a command line."""

    def run(function, *arguments: str) -> int | str | None:
        monkeypatch.setattr(sys, "argv", ["app.py", *arguments])
        try:
            main("app")(function)()
        except SystemExit as stop:
            return stop.code
        finally:
            GlobalHydra.instance().clear()
            HydraConfig.instance().cfg = None
        return 0

    return run


def problems(model: dict, **others: object) -> str:
    """What check_config says of a config with this node ``model``."""
    tree = {"model": {"_target_": f"{HERE}.Net", **model}, "scale": {"width": 8, "name": "small"}, **others}
    config = OmegaConf.create(tree)
    with pytest.raises(DrapeError) as caught:
        check_config(config, contents="app")
    return str(caught.value)


@pytest.mark.usefixtures("conf")
class TestCheck:
    def test_a_config_without_mistakes_passes(self):
        part = {"_target_": f"{HERE}.Speed"}
        model = {"_target_": f"{HERE}.Net", "width": "${scale.width}", "rate": 1, "sizes": [1, 2], "dissipation": part}
        check_config(OmegaConf.create({"model": model, "scale": {"width": 8}, "seed": 3}), contents="app")

    def test_an_argument_that_does_not_exist(self):
        expected = "conf: model.widht: Net has no argument 'widht'; did you mean 'width'?"
        assert problems({"widht": 3}) == expected

    def test_an_argument_that_is_missing(self):
        assert problems({}) == "conf: model: Net needs 'width'; set model.width"

    def test_arguments_that_the_program_supplies_are_not_missing(self):
        config = OmegaConf.create({"model": {"_target_": f"{HERE}.Net"}})
        check_config(config, contents="app", supplied={"model": ["width"]})

    def test_partial_objects_may_lack_arguments_but_not_invent_them(self):
        check_config(OmegaConf.create({"model": {"_target_": f"{HERE}.Net", "_partial_": True}}), contents="app")
        assert "no argument 'witdh'" in problems({"witdh": 3, "_partial_": True})

    @pytest.mark.parametrize(
        ("target", "told"),
        [
            (f"{HERE}.Nett", "has no 'Nett'; did you mean 'Net'?"),
            ("drape.energy.law.unet.EUNet", "drape.energy.law has no 'unet'; did you mean 'eunet'?"),
            ("drap.energy.EUNet", "there is no package 'drap'"),
            (3, "found 3; expected the dotted name"),
        ],
    )
    def test_a_target_that_cannot_be_imported(self, target, told):
        text = problems({"_target_": target, "width": 3})
        assert text.startswith("conf: model._target_: ")
        assert told in text

    @pytest.mark.parametrize(
        ("values", "told"),
        [
            ({"width": "abc"}, "model.width: found 'abc' (str); Net expects int"),
            ({"width": "${scale.name}"}, "found 'small' (str); Net expects int (the value is that of ${scale.name})"),
            ({"width": 3.5}, "model.width: found 3.5 (float); Net expects int"),
            ({"width": True}, "model.width: found True (bool); Net expects int"),
            ({"width": None}, "model.width: found None (NoneType); Net expects int"),
            ({"width": 3, "rate": "fast"}, "model.rate: found 'fast' (str); Net expects float"),
            ({"width": 3, "bias": 1}, "model.bias: found 1 (int); Net expects bool"),
            ({"width": 3, "inertia": "kinetik"}, "model.inertia: found 'kinetik' (str); Net expects Literal"),
            ({"width": 3, "sizes": [1, "b"]}, "model.sizes: found [1, 'b'] (list); Net expects list[int] | None"),
            ({"width": 3, "dissipation": 4}, "model.dissipation: found 4 (int)"),
            ({"width": 3, "dissipation": {"_target_": f"{HERE}.Stretch"}}, f"found {HERE}.Stretch; Net expects"),
        ],
    )
    def test_a_value_of_the_wrong_type(self, values, told):
        assert told in problems(values)

    def test_a_value_that_is_not_set(self):
        assert problems({"width": "???"}) == "conf: model.width is not set (???); give it a value: model.width=..."

    def test_an_interpolation_without_a_value(self):
        assert "model.width: Interpolation key 'scale.widht' not found" in problems({"width": "${scale.widht}"})

    def test_a_top_level_node_that_the_contents_page_does_not_have(self):
        assert "conf: sede: conf/app.yaml has no such node; did you mean 'seed'?" in problems({"width": 3}, sede=1)

    def test_a_member_of_a_family_that_builds_nothing(self):
        loss = {"balance": {"_target_": f"{HERE}.Speed"}, "balanc": {"sigma": 2.0}}
        assert "loss.balanc has no _target_" in problems({"width": 3}, loss=loss)

    def test_a_value_that_no_option_of_its_group_has(self):
        config = OmegaConf.create({"scale": {"width": 8, "widht": 16}})
        with pytest.raises(DrapeError, match=r"scale\.widht: no option of conf/scale/ has it; did you mean 'width'"):
            check_config(config, contents="app")

    def test_all_mistakes_are_told_at_once(self):
        assert len(problems({"widht": 3, "rate": "fast", "name": "???"}, sede=1).splitlines()) == 4

    def test_nested_objects_are_checked(self):
        nested = {"_target_": f"{HERE}.Speed", "sgima": 3.0}
        expected = "conf: model.dissipation.sgima: Speed has no argument 'sgima'; did you mean 'sigma'?"
        assert problems({"width": 3, "dissipation": nested}) == expected

    def test_a_node_used_twice_is_told_once(self):
        text = problems({"width": 3, "dissipation": {"_target_": f"{HERE}.Speed", "sgima": 1.0}}, loss="${model}")
        assert len(text.splitlines()) == 1

    def test_a_borrowed_node_must_fit_where_it_is_used(self):
        loss = {"_target_": f"{HERE}.Net", "width": 3, "dissipation": "${scale.part}"}
        text = problems({"width": 3}, loss=loss, scale={"part": {"_target_": f"{HERE}.Stretch"}})
        assert f"loss.dissipation: found {HERE}.Stretch" in text

    def test_statistics_may_come_later(self):
        node = {"_target_": f"{HERE}.Net", "width": 3, "rate": "${statistics:speed}"}
        config = OmegaConf.create({"model": node})
        check_config(config, contents="app")
        set_statistics({"speed": 2.0})
        assert config.model.rate == 2.0
        set_statistics({"sped": 2.0})
        with pytest.raises(DrapeError, match="no such statistic; did you mean 'sped'"):
            check_config(config, contents="app")
        set_statistics(None)


    def test_constructors_of_lightning_and_torch_are_understood(self):
        trainer = {"_target_": "lightning.Trainer", "accelerator": "cpu", "devices": 2, "deterministic": True}
        trainer |= {"precision": "32-true", "max_steps": -1, "profiler": None}
        adam = {"_target_": "torch.optim.Adam", "lr": 1e-3, "betas": [0.9, 0.99], "_partial_": True}
        check_config(OmegaConf.create({"model": trainer, "loss": {"adam": adam}}), contents="app")
        text = problems({**trainer, "max_step": 3, "deterministic": "yes"}, loss={"adam": {**adam, "lr": "fast"}})
        assert "Trainer has no argument 'max_step'; did you mean 'max_steps'?" in text
        assert "model.deterministic: found 'yes' (str)" in text
        assert "loss.adam.lr: found 'fast' (str)" in text


@pytest.mark.parametrize(
    ("annotation", "value", "fits"),
    [
        (Literal[1, 2], 1, True),
        (Literal[1, 2], True, False),
        (tuple[float, float], [0.9, 1], True),
        (tuple[float, float], [0.9], False),
        (tuple[int, ...], [1, 2, 3], True),
        (Path, "runs", True),
        (Path, 3, False),
        (dict[str, float], {"a": 1.0}, True),
        (dict[str, float], {"a": "b"}, False),
        (str, ["a"], False),
        (float, {"a": 1}, False),
        (float | None, None, True),
        (Callable[[int], int], {"_target_": "builtins.abs", "_partial_": True}, True),
        (float, {"_target_": "builtins.abs", "_partial_": True}, False),
        (Part, {"_target_": f"{HERE}.Speed", "_partial_": True}, False),
        ("NotImported", 3, True),
    ],
)
def test_values_and_annotations(annotation, value, fits):
    assert accepts(annotation, value, locate) is fits


class TestEntryPoint:
    def test_a_sentence_and_exit_status_2_for_what_a_user_can_put_right(self, run, capsys):
        def function(config: DictConfig) -> None:
            raise DrapeError("data/cloth.h5: not found; run src/generate.py")

        assert run(function) == 2
        assert capsys.readouterr().err == "error: data/cloth.h5: not found; run src/generate.py\n"

    def test_a_sentence_for_a_value_that_a_constructor_refuses(self, run, capsys):
        def function(config: DictConfig) -> None:
            instantiate(config.model)

        assert run(function, "model.dissipation.sigma=11") == 2
        told = capsys.readouterr().err
        assert told == "error: conf: model.dissipation: sigma is 11; expected a length below 10\n"
        assert run(function, "model.dissipation.sigma=12") == 2
        assert capsys.readouterr().err == "error: no noise at all\n"

    def test_a_fault_of_the_program_keeps_its_traceback(self, run):
        with pytest.raises(ZeroDivisionError):
            run(lambda config: 1 / 0)

    @pytest.mark.parametrize(
        ("override", "told"),
        [
            ("model.widht=3", "Key 'widht' is not in struct; did you mean 'width'?"),
            ("model=tow_parts", "Available options in 'model':"),
            ("sede=3", "Key 'sede' is not in struct; did you mean 'seed'?"),
            ("modle=one_part", "did you mean 'model'?"),
        ],
    )
    def test_a_mistake_on_the_command_line(self, run, capsys, override, told):
        assert run(lambda config: None, override) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: conf: ")
        assert told in error

    def test_an_interruption(self, run, capsys):
        def interrupted(config: DictConfig) -> None:
            raise KeyboardInterrupt

        def interrupted_in_lightning(config: DictConfig) -> None:
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt:
                sys.exit(1)

        def interrupted_in_compiled_code(config: DictConfig) -> None:
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as interrupt:
                raise SystemError("returned a result with an exception set") from interrupt

        assert run(interrupted) == 130
        assert run(interrupted_in_lightning) == 130
        assert run(interrupted_in_compiled_code) == 130
        assert capsys.readouterr().err == "interrupted; the same command goes on where this one stopped\n" * 3

    def test_other_exit_codes_pass(self, run):
        assert run(lambda config: sys.exit(7)) == 7

    @pytest.mark.parametrize(
        ("value", "quoted"),
        [
            ("a=b.obj", "\"model.name='a=b.obj'\""),
            ("a[1].obj", "\"model.name='a[1].obj'\""),
            ("a (1).obj", "\"model.name='a (1).obj'\""),
            ("é.obj", "\"model.name='é.obj'\""),
            ("a,b.obj", "\"model.name='a,b.obj'\""),
            ("~/b.obj", "\"model.name='~/b.obj'\""),
            ("it's.obj", "'model.name=\"it'\"'\"'s.obj\"'"),
        ],
    )
    def test_a_value_that_must_be_quoted_is_shown_quoted(self, run, capsys, value, quoted):
        """And what is shown works, once the shell has taken its quotes."""
        assert run(lambda config: None, f"model.name={value}") == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: conf: model.name={value}: cannot be read; a value with")
        assert f"the quotes of the shell: {quoted}; a list" in error
        assert "hydra.cc" not in error
        seen = []
        assert run(lambda config: seen.append(config.model.name), f"+{shlex.split(quoted)[0]}") == 0
        assert seen == [value]

    @pytest.mark.parametrize(
        ("code", "told"),
        [
            (errno.EROFS, "cannot use out: Read-only file system; choose a folder that can be written to"),
            (errno.ENAMETOOLONG, "cannot use out: File name too long; choose a shorter name"),
            (errno.EACCES, "cannot use out: Permission denied; set its permissions, or choose another path"),
            (errno.EDQUOT, "cannot write: .*Disk quota exceeded.*; make space on the disk"),
        ],
    )
    def test_places_that_cannot_be_used(self, run, capsys, code, told):
        def function(config: DictConfig) -> None:
            raise OSError(code, os.strerror(code), "out")

        assert run(function) == 2
        assert re.search(told, capsys.readouterr().err)

    def test_a_full_disk(self, run, capsys):
        def function(config: DictConfig) -> None:
            raise OSError(28, "No space left on device", "metrics.csv")

        assert run(function) == 2
        assert "make space on the disk" in capsys.readouterr().err

    def test_the_other_runs_of_a_multirun_go_on(self, run, capsys):
        done = []

        def function(config: DictConfig) -> None:
            done.append(config.seed)
            if config.seed == 1:
                raise DrapeError("seed 1 is not allowed")

        assert run(function, "-m", "seed=0,1,2") == 2
        assert done == [0, 1, 2]
        assert "seed 1 is not allowed; the other runs go on" in capsys.readouterr().err


class TestAblation:
    def test_effective_ablations_pass(self, run):
        seen = []

        def function(config: DictConfig) -> None:
            check_config(config, contents="app")
            check_ablation()
            seen.append((instantiate(config.model).width, "dissipation" in config.model))

        assert run(function) == 0
        assert run(function, "ablation=no_dissipation") == 0
        assert run(function, "ablation=[no_dissipation,narrow]") == 0
        assert run(function, "ablation=other_dissipation") == 0
        assert run(function, "ablation=narrow", "model=one_part") == 0
        assert seen == [(8, True), (8, False), (4, False), (8, True), (4, False)]

    def test_a_multirun_checks_each_run(self, run, tmp_path):
        assert run(lambda config: check_ablation(), "-m", "ablation=none,narrow,no_dissipation") == 0
        assert {"none", "narrow", "no_dissipation"} <= {path.name for path in (tmp_path / "runs" / "small").iterdir()}

    def test_the_run_folder_is_named_after_a_list_of_ablations(self, run, tmp_path):
        assert run(lambda config: None, "ablation=[no_dissipation,narrow]") == 0
        assert (tmp_path / "runs" / "narrow+no_dissipation").is_dir()

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (["ablation=inert"], "conf/ablation/inert.yaml: it changes nothing here (loss=all, model=two_parts)"),
            (["ablation=[narrow,inert]"], "conf/ablation/inert.yaml: it changes nothing here"),
            (["ablation=misspelt"], "model.disipation: Net has no argument 'disipation'; did you mean 'dissipation'?"),
            (["ablation=no_dissipation", "model=one_part"], "this ablation does not fit"),
            (["ablation=no_disipation"], "Available options in 'ablation'"),
        ],
    )
    def test_an_ablation_that_does_not_ablate_is_refused(self, run, capsys, arguments, told):
        assert run(lambda config: check_ablation(), *arguments) == 2
        assert told in capsys.readouterr().err
