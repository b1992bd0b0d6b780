"""The cloth presets that Blender ships, read from their files. Does not import bpy."""

from __future__ import annotations

import ast
import difflib
import importlib.metadata
import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path

from drape.errors import DrapeError

Settings = dict[str, "float | int | str"]

_ASSIGNMENT = re.compile(r"^bpy\.context\.cloth\.settings\.(\w+)\s*=\s*(.+?)\s*$")
DEFAULTS: Settings = {"bending_damping": 0.5, "bending_model": "ANGULAR", "pin_stiffness": 1.0, "time_scale": 1.0}
"""Settings that act on the cloth and that no preset file mentions, with Blender's defaults."""


def blender_version() -> str:
    """Version of the installed ``bpy``.

    Raises:
        DrapeError: it is not installed.
    """
    if importlib.util.find_spec("bpy") is None:
        raise DrapeError(
            "Blender is not installed for this Python (no module bpy); expected bpy 5.0.1, which needs Python 3.11 "
            'exactly: python3.11 -m pip install -e ".[blender]"'
        )
    return importlib.metadata.version("bpy")


def preset_directory() -> Path:
    """The folder of the cloth presets of the installed Blender."""
    blender_version()
    spec = importlib.util.find_spec("bpy")
    roots = [] if spec is None else spec.submodule_search_locations or []
    for root in roots:
        for folder in sorted(Path(root).glob("*/scripts/presets/cloth")):
            return folder
    raise DrapeError(f"bpy at {', '.join(map(str, roots))}: no folder */scripts/presets/cloth; install bpy 5.0.1")


def read_preset(name: str, directory: Path | None = None) -> Settings:
    """The settings of preset ``name`` (Blender's own names and numbers) on top of :data:`DEFAULTS`.

    A preset is a Python file of assignments ``bpy.context.cloth.settings.<name> = <literal>``; it is parsed, not run.

    Raises:
        DrapeError: no such preset, or a line that is not such an assignment.
    """
    directory = preset_directory() if directory is None else Path(directory)
    path = directory / f"{name}.py"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in directory.glob("*.py"))) or "none"
        raise DrapeError(f"material preset {name!r}: no file {path.name} in {directory}; Blender ships {known}")
    settings = dict(DEFAULTS)
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.strip().startswith(("#", "import bpy")):
            continue
        match = _ASSIGNMENT.match(line.strip())
        setting, value = match.groups() if match else ("", "")
        try:
            settings[setting] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            raise DrapeError(
                f"{path}, line {number}: found {line.strip()!r}; expected bpy.context.cloth.settings.<name> = <number>"
            ) from None
    return settings


def fabric_settings(fabric: str, preset: str, overrides: Mapping[str, float | int | str]) -> Settings:
    """A preset with single values replaced, and its name under ``preset``.

    Raises:
        DrapeError: an override that is no setting of the preset, or whose value is of another kind.
    """
    settings = read_preset(preset)
    for name, value in overrides.items():
        if name not in settings:
            close = difflib.get_close_matches(name, settings, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else f"; expected one of {', '.join(sorted(settings))}"
            raise DrapeError(f"material.{fabric}.overrides.{name}: preset {preset} has no such setting{hint}")
        if isinstance(value, str) != isinstance(settings[name], str) or value is None:
            raise DrapeError(
                f"material.{fabric}.overrides.{name}: found {value!r}; expected a value like {settings[name]!r}"
            )
        settings[name] = value
    return {"preset": preset, **settings}
