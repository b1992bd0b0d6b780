"""Find every mistake of a composed config before anything is built."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from omegaconf import Container, DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from drape.config.accepts import UNKNOWN, Borrowed, accepts
from drape.config.kinds import of_another_kind
from drape.config.pages import GLOBAL, page
from drape.config.ranges import out_of_range
from drape.config.resolvers import CONF, StatisticsUnknown
from drape.config.sentences import causes, did_you_mean
from drape.config.target import locate, why_not
from drape.errors import DrapeError

SUPPLIED = {"datamodule": ["fabrics"], "training": ["known", "data"]}
"""Arguments that the program adds itself, by the path of the object."""
INSTRUCTIONS = {"_target_", "_partial_", "_recursive_", "_convert_", "_args_"}
"""Keys that Hydra keeps for itself, in addition to the arguments of a ``_target_``."""


def check_config(
    config: DictConfig, *, contents: str = "train", supplied: Mapping[str, Collection[str]] = SUPPLIED
) -> None:
    """Refuse a config with mistakes, all of them in one message, a line each: where, found, expected, what to do.

    Found are: top-level nodes that ``conf/<contents>.yaml`` does not have; values that no option of their group has;
    values that are not set (``???``); interpolations without a value; a ``_target_`` that cannot be imported;
    arguments that it does not have, lacks, or whose values are not of the annotated type; values of another kind than
    all options give them; numbers out of their range, empty texts; members of a family (losses, callbacks) without a
    ``_target_``.
    ``supplied`` names the arguments that the program adds itself, by the dotted path of the object.

    Raises:
        DrapeError: there is at least one mistake.
    """
    problems = [*_foreign_nodes(config, contents), *_foreign_values(config)]
    tree = _plain(config, "", problems)
    problems += _walk(tree, "", supplied)
    problems += [*of_another_kind(tree, CONF, contents), *out_of_range(tree)]
    if problems:
        told = _first_of_each(problems)
        raise DrapeError("\n".join(f"conf: {problem}{_origin(config, problem)}" for problem in told))


def check_command(config: DictConfig, contents: str) -> None:
    """:func:`check_config` of what a command has composed, after its groups: ``scene=[]`` leaves one without an option.

    Raises:
        DrapeError: there is at least one mistake.
    """
    for entry in page(CONF / f"{contents}.yaml").tree.get("defaults", []):
        group = next(iter(entry)) if isinstance(entry, dict) else "hydra"
        if group in ("hydra", *config):
            continue
        nodes = [_gives(group, file) for file in (CONF / group).glob("*.yaml")]
        if nodes and all(nodes):
            raise DrapeError(f"conf: {group}: found no option; expected one, {group}=...; --help lists them")
    check_config(config, contents=contents)


def _gives(group: str, option: Path) -> bool:
    """Whether an option leaves a node of its group's name."""
    return group in contents_nodes(f"{group}/{option.stem}") if page(option).at_top else bool(page(option).tree)


def _first_of_each(problems: list[str]) -> list[str]:
    """One problem for each value."""
    first: dict[str, str] = {}
    for problem in problems:
        first.setdefault(problem.partition(": ")[0] if ": found" in problem else problem, problem)
    return list(first.values())


def mistakes(tree: object, path: str) -> Iterator[str]:
    """As :func:`check_config`, of the plain values of a single object, which the sentences call ``path``."""
    yield from _walk({path: tree}, "", {})
    yield from out_of_range({path: tree})


def _foreign_nodes(config: DictConfig, contents: str) -> Iterator[str]:
    known = contents_nodes(contents)
    for name in map(str, config):
        if name not in known:
            yield f"{name}: conf/{contents}.yaml has no such node{did_you_mean(name, known)}"


def contents_nodes(contents: str) -> set[str]:
    """The top-level nodes that a contents page can have: its own keys and the groups of its defaults list.

    Options that stand at the top themselves (``@package _global_``) may add theirs.
    """
    tree, folder = page(CONF / f"{contents}.yaml").tree, contents.rpartition("/")[0]
    nodes = set(tree) - {"defaults"}
    for entry in tree.get("defaults", []):
        if isinstance(entry, str):
            other = entry.strip("/") if entry[0] == "/" or not folder else f"{folder}/{entry}"
            nodes |= set() if entry == "_self_" else contents_nodes(other)
            continue
        group, _, package = next(iter(entry)).split()[-1].strip("/").partition("@")
        nodes.add((package or group).split("/")[0].split(".")[0])
        for option in sorted((CONF / group).glob("*.yaml")) if not package else ():
            if page(option).at_top:
                nodes |= contents_nodes(f"{group}/{option.stem}")
    return nodes


def _origin(config: DictConfig, problem: str) -> str:
    """Origin of the value at fault, if it is an interpolation."""
    parent, _, key = problem.partition(": found")[0].rpartition(".")
    node = OmegaConf.select(config, parent) if parent and ": found" in problem else None
    if not isinstance(node, DictConfig) or not OmegaConf.is_interpolation(node, key):
        return ""
    written: Any = OmegaConf.to_container(node, resolve=False)
    origin = written[key]
    group = origin.strip("${}")
    choose = f"; choose another option, {group}=..." if (CONF / group).is_dir() else ""
    return f" (the value is that of {origin}{choose})"


def _plain(node: DictConfig | ListConfig, path: str, problems: list[str]) -> Any:
    """``node`` as plain lists and dicts, UNKNOWN for values that come later; values without a value are reported."""
    is_dict = isinstance(node, DictConfig)
    plain: dict[Any, Any] = {}
    keys: Iterable[Any] = node if is_dict else range(len(node))
    for key in keys:
        where = f"{path}.{key}" if path else str(key)
        plain[key] = UNKNOWN
        if OmegaConf.is_missing(node, key):
            problems.append(f"{where} is not set (???); give it a value: {where}=...")
            continue
        try:
            value = node[key]
        except OmegaConfBaseException as error:
            if not _comes_later(error):
                problems.append(_why_unresolved(where, error))
            continue
        if not isinstance(value, DictConfig | ListConfig):
            plain[key] = value
        elif OmegaConf.is_interpolation(node, key):
            borrowed = _plain(value, where, [])
            plain[key] = Borrowed(borrowed) if isinstance(value, DictConfig) else borrowed
        else:
            plain[key] = _plain(value, where, problems)
    return plain if is_dict else list(plain.values())


def _comes_later(error: BaseException) -> bool:
    return any(isinstance(c, StatisticsUnknown) or "HydraConfig was not set" in str(c) for c in causes(error))


def _why_unresolved(path: str, error: BaseException) -> str:
    own = [str(cause).removeprefix("conf: ") for cause in causes(error) if isinstance(cause, DrapeError)]
    return f"{path}: {own[0] if own else str(error).splitlines()[0]}"


def _walk(tree: Any, path: str, supplied: Mapping[str, Collection[str]]) -> Iterator[str]:
    if not isinstance(tree, dict | list) or isinstance(tree, Borrowed):
        return
    members = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in members:
        yield from _walk(value, f"{path}.{key}" if path else str(key), supplied)
    if not path or not isinstance(tree, dict):
        return
    if "_target_" in tree:
        yield from _call(tree, path, supplied.get(path, ()))
        return
    built = list(_built(tree))
    for key, value in tree.items():
        if built and isinstance(value, dict) and "_target_" not in value:
            yield f"{path}.{key} has no _target_, as the others in {path} have{did_you_mean(str(key), built)}"


def _built(tree: Mapping[str, Any]) -> dict[str, str]:
    """Members that are objects, and the ``_target_`` of each."""
    return {k: str(node["_target_"]) for k, node in tree.items() if isinstance(node, dict) and "_target_" in node}


def _call(values: Mapping[str, Any], path: str, supplied: Collection[str]) -> Iterator[str]:
    target = values["_target_"]
    built = locate(target)
    if built is None:
        yield f"{path}._target_: {why_not(target)}"
        return
    try:
        parameters = inspect.signature(built).parameters.values()
    except (ValueError, TypeError):  # built in, without a signature
        return
    names = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    required = [p.name for p in parameters if p.name in names and p.default is p.empty]
    given = [str(key) for key in values if key not in INSTRUCTIONS]
    short = target.rpartition(".")[2]
    hints = ""
    for key in given:
        if key not in names and not any(p.kind is p.VAR_KEYWORD for p in parameters):
            hint = did_you_mean(key, names)
            hints += hint
            yield f"{path}.{key}: {short} has no argument {key!r}{hint}"
    if not values.get("_partial_"):
        for name in required[len(values.get("_args_") or ()) :]:
            if name not in given and name not in supplied and f"mean {name!r}" not in hints:
                yield f"{path}: {short} needs {name!r}; set {path}.{name}"
    annotations = _annotations(built)
    for key in given:
        if key in names and not accepts(annotations.get(key, Any), values[key], locate):
            yield f"{path}.{key}: found {_shown(values[key])}; {short} expects {_name(annotations[key])}"


def _annotations(built: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(built.__init__ if inspect.isclass(built) else built)
    except (NameError, TypeError, AttributeError):  # names imported for the type checker only
        return {}


def _shown(value: object) -> str:
    if isinstance(value, dict) and "_target_" in value:
        return str(value["_target_"])
    if isinstance(value, dict) and (built := _built(value)):
        return ", ".join(f"{key} ({target.rpartition('.')[2]})" for key, target in built.items())
    if value == {}:
        return "{} (an option that leaves its node out starts with the line '" + GLOBAL + "')"
    return f"{value!r} ({type(value).__name__})"


def _name(annotation: Any) -> str:
    if inspect.isclass(annotation):
        return annotation.__name__
    return str(annotation).replace("typing.", "").replace("collections.abc.", "")


def _foreign_values(config: DictConfig) -> Iterator[str]:
    """Plain values in the node of a group that none of the group's options has."""
    elsewhere = list(_options_at_the_top())
    for name, node in config.items_ex(resolve=False):
        group = str(name)
        files = sorted((CONF / group).glob("*.yaml"))
        if not isinstance(node, DictConfig) or "_target_" in node or not files:
            continue
        options = [page(file).tree for file in files]
        options += [tree[group] for tree in elsewhere if isinstance(tree.get(group), dict)]
        known = {str(key) for option in options for key in option} - {"defaults"}
        for key in map(str, node):
            if key not in known and not isinstance(node._get_node(key), Container):
                yield f"{group}.{key}: no option of conf/{group}/ has it{did_you_mean(str(key), known)}"


def _options_at_the_top() -> Iterator[Mapping[str, Any]]:
    """Values of the options that stand at the top themselves (``# @package _global_``), of any group."""
    for file in sorted(CONF.glob("*/*.yaml")):
        if page(file).at_top:
            yield page(file).tree
