"""GenMM as a `Generator`: motions in, motions out."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motiongen import rotations as rot
from motiongen.easing import hold_poses, limit_turns
from motiongen.errors import MotionGenError
from motiongen.features import GROUND_AXES, FeatureLayout, from_features, layout_of, rotation_features, to_features
from motiongen.generators.base import Capabilities, Generator, Progress, sample_seed, seed_number
from motiongen.generators.constraints import (
    Constraint,
    Continuation,
    FixedJoints,
    InBetween,
    Keyframes,
    Loop,
    Parts,
    RootPath,
    Segment,
    Style,
)
from motiongen.generators.devices import torch_device
from motiongen.generators.genmm.basis import principal_axes
from motiongen.generators.genmm.blending import assemble, blend
from motiongen.generators.genmm.guidance import Guidance
from motiongen.generators.genmm.keys import easing_window, far_keys
from motiongen.generators.genmm.locomotion import root_path_of, sample_along, straight_examples
from motiongen.generators.genmm.matching import distances_bytes
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.parts import skeletal_parts
from motiongen.generators.genmm.plan import CONTEXT_PATCHES, Plan, guidance_of, make_plan
from motiongen.generators.genmm.pyramid import PartSource, Pyramid, build_pyramid, resize
from motiongen.generators.genmm.stream import chunk_length, chunks
from motiongen.generators.genmm.synthesis import synthesise
from motiongen.ik import LARGEST_DROP, clean_feet
from motiongen.motion import Motion

EASE_SECONDS = 0.5
"""How long a motion takes to flow into a pose that it is held to, and out of it."""

IN_PLACE_SPEED = 0.1
"""Examples whose root drifts more slowly than this, in heights per second, loop in place."""


class GenMM(Generator):
    """Generative motion matching: mines new motions from the patches of one or a few examples, without training.

    Patches are matched at the working rate (30 Hz by default). The result is blended from frames at the examples' own
    rate by the same choice of patches, so that a 60 Hz clip gives 60 Hz detail.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(
        constraints=(Keyframes, Loop, FixedJoints, Segment, Continuation, InBetween, Style, Parts, RootPath)
    )
    options: GenMMOptions

    def __init__(self, options: GenMMOptions) -> None:
        """Take the options; refuses a device that torch does not have."""
        super().__init__(options)
        self.device = torch_device(options.device)
        self._layout: FeatureLayout
        self._examples_weighted: list[Tensor]
        self._native_examples: tuple[Motion, ...]
        self._quickest_turn: float
        self._native: Tensor
        self._like: Motion
        self._stride: int
        self._pyramids: dict[object, Pyramid]
        self._straight: GenMM | None

    @property
    def frame_rate(self) -> float:
        """The output rate where one is set, else the rate of the first example."""
        return self.options.output_rate or self.examples[0].frame_rate

    # -- examples

    def _fit(self, motions: tuple[Motion, ...]) -> None:
        self._like = motions[0]
        self._stride = max(1, round(self._like.frame_rate / self.options.working_rate))
        self._layout = layout_of(motions, contacts=True)
        self._native_examples = tuple(self._at_native_rate(motion) for motion in motions)
        self._quickest_turn = max(_quickest_turn(motion) for motion in self._native_examples)
        native = [to_features(motion, self._layout) for motion in self._native_examples]
        for motion, features in zip(motions, native):
            count = len(features[:: self._stride])
            if count < self.options.patch_size:
                raise MotionGenError(
                    f"'{motion.name}' has {count} frames at {self._like.frame_rate / self._stride:g} Hz, fewer than a "
                    f"patch of {self.options.patch_size}; give a longer clip or a smaller patch_size"
                )
        # Native frames end to end, each example padded so that working frame j starts at native frame j * stride.
        padded = [np.pad(f, ((0, -len(f) % self._stride), (0, 0)), mode="edge") for f in native]
        self._native = torch.from_numpy(np.concatenate(padded)).to(self.device)
        weights = self._weights()
        self._examples_weighted = [torch.from_numpy(f[:: self._stride] * weights).to(self.device) for f in native]
        self._pyramids = {}
        self._straight = None

    def _at_native_rate(self, motion: Motion) -> Motion:
        same = math.isclose(motion.frame_rate, self._like.frame_rate, rel_tol=1e-6)
        return motion if same else motion.resample(self._like.frame_rate)

    def _weights(self) -> np.ndarray:
        """(D,) what each feature is multiplied with for matching."""
        weights = np.ones(self._layout.size)
        weights[rotation_features(self._layout.root)] = self.options.root_rotation_weight
        # Steps are per native frame; the weight is meant for steps per working frame.
        weights[self._layout.root_steps] = self.options.root_motion_weight * self._stride
        weights[self._layout.root_height] = self.options.root_motion_weight
        weights[self._layout.contacts] = self.options.contact_weight
        weights[self._layout.foot_steps] = 0.0  # they follow from all the others, and are there for the clean-up
        return weights

    def _pyramid(self, parts: Parts | None, reduced: bool) -> Pyramid:
        """The examples at all stages for these parts, built when first needed."""
        key = (None if parts is None else (parts.preset, *parts.joints.items(), *parts.examples.items()), reduced)
        if key not in self._pyramids:
            options, examples = self.options, self._examples_weighted
            sources = [PartSource([examples[i] for i in numbers], columns) for columns, numbers in self._sources(parts)]
            basis = principal_axes(examples) if reduced else None
            self._pyramids[key] = build_pyramid(
                sources, options.patch_size, options.coarse_patches, options.scale_factor, basis
            )
        return self._pyramids[key]

    def _sources(self, parts: Parts | None) -> list[tuple[Tensor | None, Sequence[int]]]:
        """For each part its features (C,), None for all, and the numbers of the examples that it is taken from."""
        every = range(len(self._native_examples))
        if parts is None:
            return [(None, every)]
        for name, numbers in parts.examples.items():
            if max(numbers) not in every:
                raise MotionGenError(
                    f"part '{name}' is to be taken from example {max(numbers)}; there are {len(every)}, the first is 0"
                )
        return [
            (torch.from_numpy(self._layout.joint_features(joints)).to(self.device), parts.examples.get(name, every))
            for name, joints in skeletal_parts(self._layout.skeleton, parts, self._layout.feet).items()
        ]

    # -- synthesis

    def stream(
        self, chunk_frames: int | None = None, seed: int | torch.Generator = 0, constraints: Sequence[Parts] = ()
    ) -> Iterator[Motion]:
        """An endless motion, chunk by chunk; see `genmm.stream.chunks`.

        Args:
            chunk_frames: length of each chunk, ten seconds by default. Shorter ones come sooner, and long moves of
                the examples less often.
            seed: as of `sample`.
            constraints: `Parts`, or nothing.

        Raises:
            MotionGenError: if an argument is not allowed, or `output_rate` is set.
        """
        frames = chunk_length(self, chunk_frames, constraints)
        return chunks(self, frames, seed_number(seed), self._context(frames), constraints)

    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        if (path := root_path_of(constraints)) is not None:
            if self._straight is None:
                self._straight = GenMM(self.options)
                self._straight.fit(straight_examples(self._native_examples))
            return sample_along(path, self._straight, frames, count, seed, constraints, progress)
        plan = self._plan(frames, constraints)
        guidance = guidance_of(
            plan, self._layout, self._weights(), self._stride, self._examples_weighted, self.options.patch_size // 2
        )
        # Holds are columns of features; without them and without parts, fewer coordinates do.
        pyramid = self._pyramid(plan.parts, reduced=plan.parts is None and not guidance.holds)
        rounds = count * len(pyramid.stages) * self.options.iterations
        done, lock = itertools.count(1), threading.Lock()

        def advance() -> None:
            with lock:  # in order, from whichever thread
                progress(next(done) / rounds)

        def one(index: int) -> Motion:
            # By itself, not in a batch: a motion cannot depend on its neighbours' rounding.
            features = self._features(plan, pyramid, guidance, sample_seed(seed, index), advance)
            motion = self._finished(features, plan).replace(name=f"sample_{index:04d}")
            if not math.isclose(motion.frame_rate, self.frame_rate, rel_tol=1e-6):
                motion = motion.resample(self.frame_rate)[:frames]
            return motion

        with ThreadPoolExecutor(self._at_once(plan, count)) as threads:
            motions = list(threads.map(one, range(count)))
        progress(1.0)
        return motions

    def _at_once(self, plan: Plan, count: int) -> int:
        """How many syntheses run side by side: as many as there are processors, and as `memory_mb` holds."""
        if self.device.type != "cpu":
            return 1
        examples = sum(len(example) for example in self._examples_weighted)
        each = distances_bytes(math.ceil(plan.total / self._stride), examples)
        return max(1, min(count, torch.get_num_threads(), self.options.memory_mb * 2**20 // each))

    def _plan(self, frames: int, constraints: tuple[Constraint, ...]) -> Plan:
        native_rate = self._like.frame_rate
        ratio = native_rate / self.frame_rate
        in_frames = [constraint for constraint in constraints if not isinstance(constraint, Parts)]
        if in_frames and not math.isclose(ratio, 1.0, rel_tol=1e-6):
            raise MotionGenError("constraints need the examples' own frame rate; leave output_rate out")
        native_frames = math.ceil((frames - 1) * ratio - 1e-6) + 1
        return make_plan(native_frames, constraints, self._layout, native_rate, self._context(native_frames))

    def _context(self, frames: int) -> int:
        """How many frames of a neighbouring clip are held beside a synthesis of `frames` frames.

        As many as a patch of the coarsest stage spans. With fewer, that stage hardly sees what it goes on from, and
        the finer ones have to make up for a body that was to face elsewhere. No more than there are new ones.
        """
        size = self.options.patch_size
        lengths = [len(example) for example in self._examples_weighted]
        patch = sum(lengths) / len(lengths) / self.options.coarse_patches
        return self._stride * math.ceil(max(CONTEXT_PATCHES * size, min(patch, frames / self._stride)))

    def _features(
        self, plan: Plan, pyramid: Pyramid, guidance: Guidance, seed: int, advance: Callable[[], None]
    ) -> np.ndarray:
        """(plan.total, D) features at the native rate."""
        size, stride, circular = self.options.patch_size, self._stride, guidance.circular
        if circular:
            working = max(size, round(plan.total / stride))
            native_frames = working * stride
        else:
            working = max(size, math.ceil((plan.total - 1) / stride) + 1)
            native_frames = plan.total
        nearest = synthesise(pyramid, working, [seed], self.options, guidance, advance)
        sources = self._sources(plan.parts)
        blended = []
        for chosen, (columns, numbers) in zip(nearest, sources):
            native = self._native if columns is None else self._native[:, columns]
            starts = self._among_all(numbers)[chosen]
            blended.append(blend(starts, native, size, stride, native_frames, circular))
        features = assemble(blended, [columns for columns, _ in sources], self._layout.size)[0]
        if native_frames != plan.total:  # a circle of a length that the working rate does not have
            features = resize(features, plan.total, circular=True)
            features[:, self._layout.root_steps] *= native_frames / plan.total
        return features.cpu().numpy()

    def _among_all(self, numbers: Sequence[int]) -> Tensor:
        """(T,) for each working frame of some examples, end to end, its place among those of all, end to end."""
        lengths = [len(example) for example in self._examples_weighted]
        begins = itertools.accumulate(lengths, initial=0)
        places = [torch.arange(begin, begin + length) for begin, length in zip(begins, lengths)]
        return torch.cat([places[number] for number in numbers]).to(self.device)

    def _finished(self, features: np.ndarray, plan: Plan) -> Motion:
        """The motion of (plan.total, D) features, with all that is known put in and the context cut off."""
        if plan.loop is not None and self._loops_in_place(plan):
            features[:, self._layout.root_steps] -= features[:, self._layout.root_steps].mean(axis=0)
        motion = self._cleaned(features, plan)
        notes: tuple[str, ...] = ()
        for known in plan.known:
            window = EASE_SECONDS * motion.frame_rate
            if not known.dense:
                window = easing_window(motion, known, self._native_examples, window)
                notes += far_keys(known, self._native_examples, plan.lead)
            motion = hold_poses(
                motion, known.frames, known.poses, window, known.joints, known.ground, plan.loop is not None
            )
        motion = motion.replace(notes=notes)
        return motion[plan.lead : plan.lead + plan.frames] if plan.total != plan.frames else motion

    def _cleaned(self, features: np.ndarray, plan: Plan) -> Motion:
        """The motion of (plan.total, D) features without turns that are too quick, and with feet that stand still."""
        layout, frames, circular = self._layout, len(features), plan.loop is not None
        start = self._like.root_positions[0, GROUND_AXES]
        if circular:  # three rounds, of which the middle one knows no end
            start = start - features[:, layout.root_steps].sum(axis=0) * layout.skeleton.height
            features = np.tile(features, (3, 1))
        motion = from_features(features, layout, self._like, start)
        motion = limit_turns(motion, self._quickest_turn)
        feet = plan.free_feet(layout)
        if self.options.standing_feet != "free" and feet:
            chosen = [layout.feet.index(foot) for foot in feet]
            labels = features[:, layout.contacts][:, chosen] > 0.5
            slides = features[:, layout.foot_steps].reshape(len(features), -1, 2)[:, chosen]
            steps = slides if self.options.standing_feet == "example" else None
            drop = 0.0 if plan.root_is_known(layout) else LARGEST_DROP
            motion = clean_feet(motion, feet, labels, steps, largest_drop=drop)
        return motion[frames : 2 * frames] if circular else motion

    def _loops_in_place(self, plan: Plan) -> bool:
        if plan.loop is not None and plan.loop.in_place is not None:
            return plan.loop.in_place
        return self._drift(plan.parts) * self._like.frame_rate < IN_PLACE_SPEED

    def _drift(self, parts: Parts | None) -> float:
        """How far the examples of the part with the root get in a frame on average, in heights."""
        for columns, numbers in self._sources(parts):
            if columns is None or self._layout.root_steps.start in columns:
                roots = [self._native_examples[number].root_positions[:, GROUND_AXES] for number in numbers]
                way = sum(root[-1] - root[0] for root in roots) / self._layout.skeleton.height
                return float(np.linalg.norm(way)) / sum(map(len, roots))
        return 0.0


def _quickest_turn(motion: Motion) -> float:
    """The largest turn of the root about the up axis within a frame, in radians."""
    world = motion.world_rotations[:, motion.root]
    between = rot.multiply(world[1:], rot.inverse(world[:-1]))
    return float(np.abs(rot.to_rotation_vector(rot.heading(between))[:, 1]).max(initial=0.0))
