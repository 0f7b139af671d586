"""The configuration files hold the options of their dataclasses, and the options are explained."""

from __future__ import annotations

import dataclasses

import pytest
from omegaconf import OmegaConf

from motiongen.assets import config_folder
from motiongen.generators.modi.options import NetworkOptions
from motiongen.generators.options import Options
from train.settings import TrainerSettings


@pytest.mark.parametrize(
    ("group", "kind", "left_out"), [("network", NetworkOptions, {"frames"}), ("trainer", TrainerSettings, set())]
)
def test_files_hold_the_options_with_their_defaults_and_help(
    group: str, kind: type[Options], left_out: set[str]
) -> None:
    path = config_folder() / group / "modi.yaml"
    config = OmegaConf.to_container(OmegaConf.load(path))
    assert isinstance(config, dict)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    assert list(config) == [name for name in fields if name not in left_out]
    built, default = kind.build(config), kind()
    assert built == default
    lines = path.read_text().splitlines()
    for name, field in fields.items():
        if name not in left_out:
            at = next(number for number, line in enumerate(lines) if line.startswith(f"{name}:"))
            assert lines[at - 1] == f"# {field.metadata['help']}"


def test_the_defaults_are_the_papers() -> None:
    """Section 3.4 and appendix D.2."""
    settings = TrainerSettings()
    assert (settings.iterations, settings.batch, settings.learning_rate, settings.mixing) == (80_000, 16, 0.002, 0.9)
    assert (settings.contact_consistency, settings.contact_encouragement) == (1.0, 0.01)
