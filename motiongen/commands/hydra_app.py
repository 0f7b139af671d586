"""Run a Hydra application under our rules: a mistake costs one line, with the nearest valid key, and no traceback."""

from __future__ import annotations

import functools
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.errors import ConfigCompositionException, HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from motiongen.assets import config_folder
from motiongen.commands.inputs import is_pattern
from motiongen.commands.settings import leaving_no_empty
from motiongen.commands.sweep import register_sweeper
from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.registry import BUILT_IN, specs

FLAGS = ("--help", "--hydra-help", "--version", "--cfg", "--resolve", "--package", "--multirun", "--info",
         "--experimental-rerun", "--config-path", "--config-name", "--config-dir", "--shell-completion")  # fmt: skip

PATHS = ("input", "output", "from", "to", "coarse", "fine", "around", "data", "recogniser", "direction", "encoder")
"""Settings that may be paths, which may hold odd characters."""

LAUNCHER_EXTRAS = {"joblib": "sweep", "ray": "ray"}


Work = Callable[[dict[str, Any], Path], None]


def run_command(work: Work, config_name: str, arguments: Sequence[str]) -> None:
    """Run a command that needs nothing but settings and a folder (see `run_application`).

    Args:
        work: takes the composed settings as plain data, and the folder for results, which goes again if it fails
            before anything is in it.
        config_name: the primary configuration, without suffix.
        arguments: overrides (key=value) and Hydra's own flags.

    Raises:
        MotionGenError: for anything that is wrong with the arguments or the configuration, and what `work` raises.
    """
    run_application(functools.partial(_work_task, work), config_name, arguments)


def _work_task(work: Work, config: DictConfig) -> None:
    folder = Path(HydraConfig.get().runtime.output_dir)
    with leaving_no_empty(folder):
        work(cast(dict[str, Any], OmegaConf.to_container(config, resolve=True)), folder)


def run_application(task: Callable[[DictConfig], None], config_name: str, arguments: Sequence[str]) -> None:
    """Compose `config_name` with the overrides in `arguments` and call `task` with the result.

    With `-m` the task runs once for each combination of values (see `sweep`), perhaps in another process.

    Args:
        task: what to do with the composed configuration; a function that other processes can import. The file
            `sweep.COMPLETE`, with the text of `sweep.composed_text`, is the last that it writes into its folder.
        config_name: the primary configuration, without suffix.
        arguments: overrides (key=value) and Hydra's own flags.

    Raises:
        MotionGenError: for anything that is wrong with the arguments or the configuration.
    """
    _check_arguments(arguments, config_name)
    _offer_plug_ins()
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # exceptions come through, for us to put in words
    register_sweeper()
    mistakes: list[MotionGenError] = []

    def collecting(config: DictConfig) -> None:
        try:
            task(config)
        except MotionGenError as error:
            if HydraConfig.get().mode is RunMode.MULTIRUN:
                raise  # into the sweep, which knows what to do with it
            mistakes.append(error)  # raised through Hydra, it would be printed by it as well

    application = hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=config_name)(collecting)
    before = sys.argv
    overrides = [a for a in arguments if re.match(r"[^-].*=|~", a)]
    flags = [a for a in arguments if a not in overrides]
    # Flags first, wherever they stood: Hydra's parser does not take overrides from both sides of one.
    sys.argv = [f"motiongen {config_name}", *flags, *map(_quoted, overrides)]
    try:
        application()
    except (HydraException, OmegaConfBaseException) as error:
        choices = [override for override in overrides if override.startswith(("generator=", "constraint=", "task="))]
        raise MotionGenError(_explained(error, config_name, choices)) from error
    except ValueError as error:
        if "Config group override" not in str(error):
            raise
        raise MotionGenError(
            "a group is set to nothing; choose one, such as generator=genmm, or leave it out"
        ) from error
    except BrokenPipeError:
        raise
    except OSError as error:  # Hydra makes the folder for results
        raise MotionGenError(f"the results cannot be written ({error}); choose another output") from error
    except SystemExit as leaving:  # after --help and the like; a success is none of the caller's concern
        if leaving.code not in (0, None):
            raise
    finally:
        sys.argv = before
    if mistakes:
        raise mistakes[0]


def _check_arguments(arguments: Sequence[str], config_name: str) -> None:
    for argument in arguments:
        if argument.startswith("~") and not argument.startswith("~hydra"):
            raise MotionGenError(
                f"'{argument}' takes a setting away, and each is needed; {argument[1:]}=null is for nothing"
            )
        flag = argument.split("=")[0]
        if flag.startswith("--") and not any(known.startswith(flag) for known in FLAGS):
            raise MotionGenError(
                f"{config_name} takes settings as key=value, such as seed=1, and has no flag '{flag}'; see --help"
            )


def _offer_plug_ins() -> None:
    """Let `generator=NAME` choose the generators of other packages, with their options' defaults."""
    built_in = {spec.name for spec in BUILT_IN}
    store = ConfigStore.instance()
    for name, spec in specs().items():
        if name not in built_in and spec.error is None:
            store.store(group="generator", name=name, node={"name": name, **spec.options_type()().to_dict()})


def _quoted(argument: str) -> str:
    """`key=path` with the path in quotes where Hydra's grammar would stumble over it."""
    key, equals, value = argument.partition("=")
    plain = re.fullmatch(r"[\w./~+-]*", value) is not None
    if not equals or plain or key not in PATHS or value[0] in "[{'\"" or "${" in value:
        return argument
    is_list = "," in value or "(" in value  # as far as one can tell where no such file exists
    if key == "input" and not Path(value).exists() and (is_list or not is_pattern(value)):
        return argument
    escaped = value.replace("\\", "\\\\").replace("'", "\\'")
    return f"{key}='{escaped}'"


def _explained(error: Exception, config_name: str, choices: Sequence[str]) -> str:
    """One line for what Hydra or OmegaConf found wrong."""
    if isinstance(error, MissingConfigException) and error.missing_cfg_file is not None:
        group, _, choice = error.missing_cfg_file.rpartition("/")
        options = list(error.options or [])
        if group == "hydra/launcher" and choice in LAUNCHER_EXTRAS:
            extra = f"needs the extra '{LAUNCHER_EXTRAS[choice]}': pip install 'motiongen[{LAUNCHER_EXTRAS[choice]}]'"
            return f"{group}={choice} {extra}; without it, the runs of a sweep go one after the other"
        near = nearest_of(choice, options) or ";"
        return f"there is no {group or 'configuration'} '{choice}'{near} there are {', '.join(options) or 'none'}"
    if isinstance(error, OverrideParseException):
        return f"cannot read the setting '{error.override}'; write key=value, with quotes around odd characters"
    cause = error.__cause__ if isinstance(error, ConfigCompositionException) else error
    key = getattr(cause, "full_key", None) or getattr(cause, "key", None)
    if isinstance(cause, OmegaConfBaseException) and key is not None and "not in struct" in str(cause):
        return _unknown_key(str(key), config_name, choices)
    return " ".join(str(cause or error).split("\n")[0].split())


def _unknown_key(key: str, config_name: str, choices: Sequence[str]) -> str:
    """Name the nearest of the settings that the chosen generator has."""
    with hydra.initialize_config_dir(str(config_folder().resolve()), version_base="1.3"):
        config = hydra.compose(config_name, overrides=list(choices))
    keys = _all_keys(config)
    parent = key.rpartition(".")[0]
    near = nearest_of(key, keys) or nearest_of(f"generator.{key}", keys)
    siblings = [k for k in keys if k.rpartition(".")[0] == parent] or [k for k in keys if "." not in k]
    return f"unknown setting '{key}'{near or ';'} the settings are {', '.join(siblings)}"


def _all_keys(config: DictConfig, prefix: str = "") -> list[str]:
    keys: list[str] = []
    for key in config:
        full = f"{prefix}{key!s}"
        keys.append(full)
        if OmegaConf.is_dict(config._get_node(key)):  # not resolved: an interpolation may not be resolvable here
            keys += _all_keys(config[key], full + ".")
    return keys
