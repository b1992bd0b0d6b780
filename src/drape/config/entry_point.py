"""Entry points: Hydra's main with sentences instead of tracebacks, and building the objects of a config."""

from __future__ import annotations

import errno
import functools
import os
import re
import shlex
import signal
import sys
import traceback
from collections.abc import Callable
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, InstantiationException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from drape.config.check import check_command
from drape.config.resolvers import CONF, show_statistics
from drape.config.sentences import causes, did_you_mean
from drape.errors import DrapeError

REFUSED = 2
"""Exit status when the user can put it right."""
FULL_DISK = ("No space left on device", "Disk quota exceeded", "PytorchStreamWriter failed writing")
"""Words of the system, HDF5 and PyTorch for it."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NOT_A_PLACE = {
    errno.EACCES: "set its permissions, or choose another path",
    errno.EPERM: "set its permissions, or choose another path",
    errno.EROFS: "choose a folder that can be written to: folder=...",
    errno.ENOTDIR: "a file is in the way: choose another path",
    errno.EEXIST: "a file is in the way: choose another path",
    errno.EISDIR: "a folder is in the way: choose another path",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ELOOP: "links there lead in a circle: choose another path",
}
"""Error number of a path that cannot be used -> remedy."""
UNQUOTED = (
    "LexerNoViableAltException", "mismatched input", "no viable alternative", "extraneous input", "Ambiguous value",
)  # fmt: skip
"""Words of Hydra's errors for ``path=a=b.obj``, ``path=a[1].obj``, ``path=é.obj`` and ``path=a,b.obj``."""
NO_OPTION = "Config group override must be"
"""Words of Hydra's error for ``scene=null`` and ``scene=3``."""
INTERRUPTED, TERMINATED = 130, 143
"""Exit status after Ctrl+C and after SIGTERM, as shells count them."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, as a scheduler sends it before it kills: an interruption like Ctrl+C."""


def _terminate(*_: object) -> None:
    raise Terminated


def main(config_name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], None]]:
    """Make a function of the config the entry point of the contents page ``conf/<config_name>.yaml``.

    What a user can put right (see :func:`refusal`) becomes one sentence and exit status 2, Ctrl+C a sentence and 130;
    SIGTERM the same and 143; all else keeps its traceback. In a multirun the other runs go on first.
    """

    def decorate(function: Callable[[DictConfig], Any]) -> Callable[[], None]:
        @functools.wraps(function)
        def task(config: DictConfig) -> Any:
            try:
                check_command(config, config_name)
                return function(config)
            except Exception as error:
                if _interrupted(error):
                    raise next(c for c in causes(error) if isinstance(c, KeyboardInterrupt)) from error
                sentence = refusal(error)
                if sentence is not None and HydraConfig.get().mode != RunMode.MULTIRUN:
                    _stop(sentence)
                if sentence is not None:
                    _say(f"error: {sentence}; the other runs go on")
                raise

        @functools.wraps(function)
        def run() -> None:
            os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra hands its errors over instead of printing them itself
            if "--resolve" in sys.argv:
                show_statistics()
            before = signal.signal(signal.SIGTERM, _terminate)
            try:
                hydra.main(version_base=None, config_path=str(CONF), config_name=config_name)(task)()
            except (KeyboardInterrupt, SystemExit) as stop:
                if not _interrupted(stop):
                    raise
                _say("interrupted; the same command goes on where this one stopped")
                sys.exit(TERMINATED if any(isinstance(cause, Terminated) for cause in causes(stop)) else INTERRUPTED)
            except Exception as error:
                sentence = refusal(error)
                if sentence is None:
                    raise
                _stop(sentence)
            finally:
                signal.signal(signal.SIGTERM, before)

        return run

    return decorate


def refusal(error: BaseException) -> str | None:
    """The sentence for the user; None where not the user is to blame but the program.

    A :class:`DrapeError` anywhere among the causes, a config that Hydra cannot compose, a full disk, a path where
    nothing can be written.
    """
    for cause in causes(error):
        if isinstance(cause, DrapeError):
            return str(cause)
        if isinstance(cause, HydraException) and any(words in str(cause) for words in UNQUOTED):
            return _unquoted(cause)
        if isinstance(cause, HydraException) and not isinstance(cause, InstantiationException):
            return _composition(cause)
        if NO_OPTION in str(cause):
            return f"conf: {cause}: expected the name of an option, as in scene=sphere; --help lists them"
        if any(words in str(cause) for words in FULL_DISK) or _errno(cause) in FULL:
            return f"cannot write: {cause}; make space on the disk and run the same command again"
        if type(cause).__name__ == "MisconfigurationException":  # Lightning's
            return f"conf: trainer: {cause}".rstrip(".") + "; choose another trainer=..."
        if (number := _errno(cause)) in NOT_A_PLACE:
            place = getattr(cause, "filename", None) or cause
            return f"cannot use {place}: {os.strerror(number)}; {NOT_A_PLACE[number]}"
        if isinstance(cause, FileNotFoundError) and _made_a_folder(cause):
            return f"cannot use {cause.filename}: no folder can be made there; choose another path: folder=..."
    return None


def _errno(cause: BaseException) -> int | None:
    """The system's number of an error, also where a library only quotes it."""
    if isinstance(cause, OSError) and cause.errno is not None:
        return cause.errno
    quoted = re.search(r"\berrno = (\d+)|\[Errno (\d+)\]", str(cause))
    return int(next(filter(None, quoted.groups()))) if quoted else None


def _made_a_folder(error: FileNotFoundError) -> bool:
    """Whether a folder was to be made, as in /proc, where the system says that there is none."""
    return traceback.extract_tb(error.__traceback__)[-1].name in ("mkdir", "makedirs")


def _unquoted(error: HydraException) -> str:
    """Sentence with the right quotes for a value that Hydra takes for more than one word."""
    given = getattr(error, "override", None) or re.findall(r"'(.*=.*)'\n", str(error) + "\n")[0]
    key, _, value = given.partition("=")
    quote = '"' if "'" in value else "'"
    quoted = f"{key}={quote}{value}{quote}"
    shell = shlex.quote(quoted) if set('"$`\\!') & set(quoted) else f'"{quoted}"'
    return (
        f"conf: {given}: cannot be read; a value with = , : [ ] ( ) {{ }} # ~ quotes or accents is written in quotes "
        f"inside the quotes of the shell: {shell}; a list as '{key}=[a,b]'"
    )


def _composition(error: HydraException) -> str:
    """Message of Hydra and OmegaConf without the list of folders searched, with a suggestion for a misspelt key."""
    text, hint = [], ""
    for cause in causes(error):
        if isinstance(cause, HydraException | OmegaConfBaseException):
            text += [line.strip() for line in str(cause).partition("Config search path:")[0].splitlines()]
        if isinstance(cause, OmegaConfBaseException) and isinstance(cause.parent_node, DictConfig):
            hint = did_you_mean(str(cause.key).rpartition(".")[2], map(str, cause.parent_node))
    noise = ("full_key", "object_type", "To append")
    lines = [line for line in dict.fromkeys(text) if line and not line.startswith(noise)]
    if any(line.startswith("In 'ablation/") for line in lines):
        lines.append("this ablation does not fit the rest of the configuration; choose another, or ablation=none")
    return "conf: " + "\n  ".join(lines) + hint


def _interrupted(stop: BaseException) -> bool:
    """Ctrl+C, also where Lightning has turned it into ``exit(1)``, or Numba into a SystemError."""
    return any(isinstance(cause, KeyboardInterrupt) for cause in causes(stop))


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)


def _stop(sentence: str) -> None:
    _say(f"error: {sentence}")
    sys.exit(REFUSED)


def instantiate(node: DictConfig, **supplied: object) -> Any:
    """Build the object of a ``_target_``, with plain lists and dicts as arguments and ``supplied`` added to them.

    Raises:
        DrapeError: a constructor refuses a value (ValueError); where, and the constructor's own sentence.
    """
    try:
        return hydra.utils.instantiate(node, _convert_="all", **supplied)
    except InstantiationException as error:
        for cause in causes(error.__cause__):
            if isinstance(cause, DrapeError):
                raise DrapeError(str(cause)) from error
            if isinstance(cause, ValueError):
                where = str(error).rpartition("full_key: ")[2] if "full_key: " in str(error) else node.get("_target_")
                raise DrapeError(f"conf: {where}: {cause}") from error
        raise
