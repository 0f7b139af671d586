"""Files of codes: what is written is read, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

import motiongen as mg
from motiongen.errors import MotionGenError
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.latents import FORMAT, load_latents, save_latents
from motiongen.generators.modi.model_files import fingerprint
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", FIGURE, (4, 6))


@pytest.fixture(scope="module")
def generator(checkpoint: Path) -> MoDi:
    return modi(checkpoint)


def modi(folder: Path) -> MoDi:
    made = mg.create("modi", checkpoint=str(folder))
    assert isinstance(made, MoDi)
    return made


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("count", [0, 1, 5])
def test_codes_and_names_come_back_bit_for_bit(generator: MoDi, tmp_path: Path, wide: bool, count: int) -> None:
    shape = (count, generator.latent_layers, generator.latent_size) if wide else (count, generator.latent_size)
    codes = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    names = [f"Schritt {number}: ein „Gang“" for number in range(count)]
    save_latents(tmp_path / "codes.safetensors", generator, codes, names)
    found = load_latents(tmp_path / "codes.safetensors", generator)
    np.testing.assert_array_equal(found.codes, codes)
    assert found.codes.dtype == np.float32
    assert found.names == tuple(names)


def test_views_of_arrays_are_written_as_they_look(generator: MoDi, tmp_path: Path) -> None:
    codes = np.random.default_rng(0).standard_normal((generator.latent_size, 6))
    save_latents(tmp_path / "codes.safetensors", generator, codes.T[::2], ["a", "b", "c"])
    found = load_latents(str(tmp_path / "codes.safetensors"), generator).codes
    np.testing.assert_array_equal(found, codes.T[::2].astype(np.float32))


def test_the_fingerprint_is_that_of_the_weights_alone(generator: MoDi, checkpoint: Path, tmp_path: Path) -> None:
    again = mg.create("modi", checkpoint=str(checkpoint), truncation=0.5, clean_feet=False)
    assert isinstance(again, MoDi)
    assert fingerprint(again) == fingerprint(generator)
    other = modi(random_checkpoint(tmp_path / "other", FIGURE, (4, 6), latent_size=16))
    assert fingerprint(other) != fingerprint(generator)
    with_change = modi(checkpoint)
    with_change.network.mean_code[0] += 1e-3
    assert fingerprint(with_change) != fingerprint(generator)


def test_codes_of_another_model_are_refused(generator: MoDi, checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "codes.safetensors"
    save_latents(path, generator, generator.latents(2), ["a", "b"])
    other = modi(checkpoint)
    other.network.mean_code[0] += 1e-3
    with pytest.raises(MotionGenError, match="of another model; take the checkpoint that it was made with"):
        load_latents(path, other)


@pytest.mark.parametrize(
    ("name", "shape", "names", "words"),
    [
        ("codes.npz", (2, 8), 2, r"end in \.safetensors"),
        ("codes.safetensors", (2, 8), 3, "2 latents need as many names, not 3"),
        ("codes.safetensors", (2, 9), 2, r"must have the shape"),
        ("no/codes.safetensors", (2, 8), 2, "does not exist"),
    ],
)
def test_what_cannot_be_written_leaves_nothing(
    generator: MoDi, tmp_path: Path, name: str, shape: tuple[int, int], names: int, words: str
) -> None:
    with pytest.raises(MotionGenError, match=words):
        save_latents(tmp_path / name, generator, np.zeros(shape), ["a"] * names)
    assert list(tmp_path.iterdir()) == []


def test_codes_that_are_not_finite_are_not_written(generator: MoDi, tmp_path: Path) -> None:
    codes = generator.latents(2)
    codes[1, 3] = np.nan
    with pytest.raises(MotionGenError, match="not finite"):
        save_latents(tmp_path / "codes.safetensors", generator, codes, ["a", "b"])


def test_every_shortened_file_is_refused_in_one_line(generator: MoDi, tmp_path: Path) -> None:
    path = tmp_path / "codes.safetensors"
    save_latents(path, generator, generator.latents(2), ["a", "b"])
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        with pytest.raises(MotionGenError) as caught:
            load_latents(path, generator)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize("damage", ["names", "model", "format"])
def test_files_that_lack_what_they_must_say_are_refused(generator: MoDi, tmp_path: Path, damage: str) -> None:
    notes = {"format": str(FORMAT), "model": fingerprint(generator), "names": json.dumps(["a", "b"])}
    path = tmp_path / "codes.safetensors"
    path.write_bytes(save({"codes": generator.latents(2)}, notes))
    load_latents(path, generator)  # sound as it is
    del notes[damage]
    path.write_bytes(save({"codes": generator.latents(2)}, notes))
    with pytest.raises(MotionGenError, match="no file of latents"):
        load_latents(path, generator)


@pytest.mark.parametrize(
    ("tensors", "change", "words"),
    [
        ({"codes": (2, 8)}, {"names": '["a"]'}, "2 latents with 1 names; the file is damaged"),
        ({"codes": (2, 8)}, {"names": "a, b"}, "no file of latents"),
        ({"codes": (2, 8)}, {"format": str(FORMAT + 1)}, f"format {FORMAT + 1}; .* update motiongen"),
        ({"codes": (2, 8)}, {"format": "new"}, "no file of latents"),
        ({"codes": (2, 7)}, {}, "must have the shape"),
        ({"weights": (2, 8)}, {}, "no file of latents"),
    ],
)
def test_files_that_contradict_themselves_are_refused(
    generator: MoDi, tmp_path: Path, tensors: dict[str, Any], change: dict[str, str], words: str
) -> None:
    notes = {"format": str(FORMAT), "model": fingerprint(generator), "names": json.dumps(["a", "b"])} | change
    path = tmp_path / "codes.safetensors"
    path.write_bytes(save({name: np.zeros(shape, dtype=np.float32) for name, shape in tensors.items()}, notes))
    with pytest.raises(MotionGenError, match=words):
        load_latents(path, generator)


def test_what_is_no_file_is_refused(generator: MoDi, tmp_path: Path) -> None:
    with pytest.raises(MotionGenError, match="there is no such file"):
        load_latents(tmp_path / "nothing.safetensors", generator)
    with pytest.raises(MotionGenError, match="a directory"):
        load_latents(tmp_path, generator)
