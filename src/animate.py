"""Animate a scene with the energies that it needs: ``python src/animate.py scene=sphere energy=eunet_baked``."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from drape import config as conf
from drape.blender.output import export, render
from drape.contact.coarseness import too_coarse
from drape.data.animation_hdf5 import AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.scene_step import SceneSteps
from drape.report.animated import animated, explained
from drape.report.preview import preview
from drape.simulators.choice import simulator_of
from drape.simulators.device import check_device
from drape.simulators.rollout import COLUMNS, roll_out
from drape.simulators.simulator import barrier_of

SHAPES_FRAMES = ("scene", "fabric", "energy", "contact", "simulator")
"""Groups of the config that determine the frames."""


@conf.main("animate")
def main(config: DictConfig) -> None:
    check_device(config.simulator.get("device", "cpu"))
    output, folder = conf.instantiate(config.output), Path(config.folder)
    scene = conf.instantiate(config.scene)
    fabric = conf.instantiate(config.energy)
    potential = IncrementalPotential.for_scene(scene, fabric.terms, conf.instantiate(config.contact))
    simulator = simulator_of(config.simulator, potential, scene, fabric.attributes)
    contact = potential.contact
    coarse = None if contact is None else too_coarse(scene.mesh, scene.obstacle, contact.per_edge, contact.thickness)
    if contact is not None and coarse and contact.sharp_points(scene) is None:
        print(coarse)
    if config.explain:
        steps = SceneSteps(scene, fabric.attributes, config.simulator.get("device", "cpu"), contact)
        Console().print(explained(potential, steps.step(scene.initial, 0.0, 1.0)).terminal())
        return
    settings = {name: OmegaConf.to_container(config[name], resolve=True) for name in SHAPES_FRAMES}
    path = folder / "animation.h5"
    with AnimationWriter(path, AnimationHeader.of_scene(scene, COLUMNS, OmegaConf.to_yaml(settings))) as writer:
        roll_out(simulator, scene, writer)
    made = [path, *export(path, output.formats, folder)]
    if output.render == "preview":
        made.append(preview(path, folder / "preview.png"))
    elif output.render == "cycles":
        made.append(render(path, folder, output.samples, output.size, output.every))
    print(animated(path, scene, made, barrier_of(simulator)))


if __name__ == "__main__":
    main()
