"""The encoder: what it is given, what it gives back, and what can be done with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import motiongen as mg
from motiongen import rotations as rot
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.modi.alignment import bring, standardised
from motiongen.generators.modi.composites import cut_off, noised, spliced, with_joints
from motiongen.generators.modi.encoder import FORMAT, WEIGHTS, Encoder, new_network, save_tensors
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import InversionOptions, invert
from motiongen.generators.modi.model_files import fingerprint
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE, stride
from tests.train.runs import FRAMES, make_dataset, training_of

Floats = NDArray[np.float32]


@pytest.fixture(scope="module")
def generator(tmp_path_factory: pytest.TempPathFactory) -> MoDi:
    folder = tmp_path_factory.mktemp("encoder")
    training_of(Dataset.open(make_dataset(folder))).save(folder / "checkpoint", {})
    made = mg.create("modi", checkpoint=str(folder / "checkpoint"), clean_feet=False)
    assert isinstance(made, MoDi)
    return made


@pytest.fixture(scope="module")
def encoder(generator: MoDi) -> Encoder:
    torch.manual_seed(0)
    return Encoder(generator, new_network(generator))


def window(generator: MoDi, seed: int) -> Floats:
    return bring(generator.card, stride(seed, frames=FRAMES)).cut().windows[0]


# -- composites


@given(seeds=st.tuples(st.integers(0, 20), st.integers(0, 20)), at=st.integers(1, FRAMES - 1))
def test_a_splice_goes_on_as_its_second_part_does(generator: MoDi, seeds: tuple[int, int], at: int) -> None:
    layout = generator.card.layout
    first, second = (window(generator, seed) for seed in seeds)
    whole = spliced(layout, first, second, at)
    np.testing.assert_array_equal(whole[:at], first[:at])
    below = slice(1, layout.root)
    assert rot.angle_between(whole[at:, below], second[at:, below]).max() < 1e-3
    np.testing.assert_array_equal(whole[at:, layout.contacts], second[at:, layout.contacts])
    steps = [np.linalg.norm(each[at:, layout.root, [0, 2]], axis=-1) for each in (whole, second)]
    np.testing.assert_allclose(*steps, atol=1e-5)
    np.testing.assert_allclose(whole[at:, layout.root, 1], second[at:, layout.root, 1], atol=1e-6)
    # The second part is turned about the up axis alone, so that it heads at the seam as the first one does.
    turn = rot.multiply(whole[at:, 0], rot.inverse(second[at:, 0]))
    assert rot.angle_between(turn, rot.heading(turn[0])).max() < 1e-3
    there = rot.multiply(turn[0], second[at - 1, 0])
    assert rot.angle_between(rot.heading(rot.multiply(first[at - 1, 0], rot.inverse(there))), rot.IDENTITY) < 1e-3
    assert (np.einsum("jc,jc->j", whole[at - 1, layout.joints], whole[at, layout.joints]) >= 0).all()


@given(seed=st.integers(0, 20), at=st.integers(1, FRAMES - 1))
def test_a_motion_spliced_with_itself_is_itself(generator: MoDi, seed: int, at: int) -> None:
    motion = window(generator, seed)
    np.testing.assert_allclose(spliced(generator.card.layout, motion, motion, at), motion, atol=1e-6)


@given(joints=st.sets(st.integers(0, 6), min_size=1))
def test_joints_of_another_bring_what_belongs_to_them(generator: MoDi, joints: set[int]) -> None:
    layout = generator.card.layout
    one, other = window(generator, 1), window(generator, 2)
    whole = with_joints(layout, one, other, sorted(joints))
    taken = joints | ({layout.root} if 0 in joints else set())
    taken |= {layout.contacts.start + k for k, foot in enumerate(layout.feet) if foot in joints}
    for entity in range(layout.count):
        np.testing.assert_array_equal(whole[:, entity], (other if entity in taken else one)[:, entity])


def test_what_is_cut_off_is_zero_to_the_network(generator: MoDi) -> None:
    motion = window(generator, 3)
    cut = cut_off(generator.card, motion, 5)
    np.testing.assert_array_equal(cut[:5], motion[:5])
    np.testing.assert_allclose(standardised(generator.card, cut)[5:], 0, atol=1e-6)


def test_noise_is_as_large_as_asked_for_and_leaves_labels(generator: MoDi) -> None:
    card, random = generator.card, np.random.default_rng(0)
    motions = np.stack([window(generator, seed) for seed in range(20)])
    noisy = np.stack([noised(card, motion, random, 0.3) for motion in motions])
    apart = standardised(card, noisy) - standardised(card, motions)
    np.testing.assert_array_equal(apart[:, :, card.layout.contacts], 0)
    assert apart[:, :, : card.layout.root].std() == pytest.approx(0.3, rel=0.05)


# -- the encoder


def test_codes_are_those_of_each_window_by_itself(encoder: Encoder) -> None:
    generator = encoder.generator
    windows = np.stack([window(generator, seed) for seed in range(3)])
    codes = encoder.codes(windows)
    assert codes.shape == (3, generator.latent_layers, generator.latent_size)
    np.testing.assert_array_equal(codes[1:2], encoder.codes(windows[1:2]))
    for code, motion in zip(codes, standardised(generator.card, windows)):
        with torch.no_grad():
            expected = encoder.network(torch.from_numpy(motion)[None])[0]
        np.testing.assert_array_equal(code, expected.numpy())


def test_a_head_that_says_nothing_gives_the_mean_code(generator: MoDi) -> None:
    network = new_network(generator)
    with torch.no_grad():
        for weight in network.head[-1].parameters():
            weight.zero_()
    codes = Encoder(generator, network).codes(window(generator, 0)[None])
    np.testing.assert_array_equal(codes[0], np.tile(generator.mean_latent(), (generator.latent_layers, 1)))


def test_encoding_cuts_clips_as_inversion_does(encoder: Encoder) -> None:
    clip = stride(5, frames=FRAMES + 20)
    found = encoder.encode(clip)
    sought = invert(encoder.generator, clip, InversionOptions(steps=1), guess=found.codes)
    assert [motion.name for motion in found.motions] == [motion.name for motion in sought.motions]
    assert list(found.targets) == list(sought.targets)
    assert found.report[:-1] == sought.report[:-1]
    assert len(encoder.encode(clip, windows=2).codes) == 2
    np.testing.assert_array_equal(encoder.denoise(clip).codes, found.codes)


def test_fused_motions_are_those_of_the_splice(encoder: Encoder) -> None:
    generator = encoder.generator
    first, second = stride(1, frames=FRAMES + 9), stride(2, frames=FRAMES + 4)
    found = encoder.fuse(first, second, 6)
    begin = bring(generator.card, first).window(0, FRAMES)
    end = bring(generator.card, second).window(4, FRAMES)
    whole = spliced(generator.card.layout, begin, end, 6)
    np.testing.assert_array_equal(found.codes, encoder.codes(whole[None]))
    assert len(found.motions) == len(found.targets) == 1
    assert rot.angle_between(found.targets[0].rotations, whole[:, :7]).max() < 1e-3
    assert "the first 6 frames of 'clip1', then the last ones of 'clip2'" in found.report


def test_edited_joints_are_those_of_the_source(encoder: Encoder) -> None:
    generator = encoder.generator
    motion, source = stride(1, frames=FRAMES), stride(2, frames=FRAMES)
    found = encoder.edit_joints(motion, "Left*", source)
    joints = FIGURE.select("Left*")
    whole = with_joints(generator.card.layout, window(generator, 1), window(generator, 2), joints)
    np.testing.assert_array_equal(found.codes, encoder.codes(whole[None]))
    np.testing.assert_array_equal(encoder.edit_joints(motion, ["*"], source).codes, encoder.encode(source).codes)
    with pytest.raises(MotionGenError, match="no joint matches 'Wing'"):
        encoder.edit_joints(motion, "Wing", source)


@pytest.mark.parametrize(("length", "frames", "known"), [(1, 5, 1), (6, 10, 6), (40, 10, FRAMES - 10), (40, 1, 15)])
def test_predictions_begin_as_the_clip_ends(encoder: Encoder, length: int, frames: int, known: int) -> None:
    generator, clip = encoder.generator, stride(1, frames=length)
    found = encoder.predict(clip, frames)
    assert len(found.motions[0]) == known + frames
    assert len(found.targets[0]) == known
    track = bring(generator.card, clip)
    expected = track.window(length - known, known)
    assert rot.angle_between(found.targets[0].rotations, expected[:, :7]).max() < 1e-3
    padded = np.concatenate([expected, np.zeros((FRAMES - known, *expected.shape[1:]), np.float32)])
    np.testing.assert_array_equal(found.codes, encoder.codes(cut_off(generator.card, padded, known)[None]))


def test_what_a_window_cannot_hold_is_refused(encoder: Encoder) -> None:
    clip = stride(0, frames=FRAMES)
    with pytest.raises(MotionGenError, match="frames must be a whole number from 1 to 15, not 16"):
        encoder.predict(clip, FRAMES)
    with pytest.raises(MotionGenError, match="first_frames must be a whole number from 1 to 15, not 0"):
        encoder.fuse(clip, clip, 0)
    with pytest.raises(MotionGenError, match="has 10 frames"):
        encoder.fuse(stride(0, frames=10), clip, 3)


# -- files


def test_an_encoder_comes_back_as_it_was_and_belongs_to_its_model(encoder: Encoder, tmp_path: Path) -> None:
    generator = encoder.generator
    notes = {"format": FORMAT, "model": fingerprint(generator)}
    save_tensors(tmp_path / WEIGHTS, notes, encoder.network.state_dict())
    windows = window(generator, 0)[None]
    np.testing.assert_array_equal(Encoder.load(tmp_path, generator).codes(windows), encoder.codes(windows))
    other = mg.create("modi", checkpoint=str(random_checkpoint(tmp_path / "other", FIGURE)))
    assert isinstance(other, MoDi)
    with pytest.raises(MotionGenError, match="of another model; take the checkpoint"):
        Encoder.load(tmp_path, other)
    save_tensors(tmp_path / WEIGHTS, notes | {"format": FORMAT + 1}, encoder.network.state_dict())
    with pytest.raises(MotionGenError, match=f"in format {FORMAT + 1}; this version reads up to {FORMAT}"):
        Encoder.load(tmp_path, generator)
    save_tensors(tmp_path / WEIGHTS, notes, {"head.0.weight": torch.zeros(1)})
    with pytest.raises(MotionGenError, match="the weights are not the encoder's"):
        Encoder.load(tmp_path, generator)
    (tmp_path / WEIGHTS).write_bytes(b"nothing of the kind")
    with pytest.raises(MotionGenError, match="this is no encoder"):
        Encoder.load(tmp_path, generator)
    with pytest.raises(MotionGenError, match="there is no such file"):
        Encoder.load(tmp_path / "nowhere", generator)
