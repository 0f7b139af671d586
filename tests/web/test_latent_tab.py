"""The tab of a latent space, on a page that is not there, with a generator whose codes have no layers."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.generators.base import Capabilities, Generator, LatentGenerator, Progress
from motiongen.motion import Motion
from motiongen.web.desk import Belongings, Desk
from motiongen.web.jobs import JobQueue
from motiongen.web.latent_tab import LatentTab
from motiongen.web.limits import Limits
from motiongen.web.places import Place, Space, code_of, space_of
from tests.web.fakes import Client

CLIP = mg.load(EXAMPLE_CLIP)[:20]
PATIENCE_SECONDS = 30.0


class Jumping(LatentGenerator):
    """Its codes (3,) are where the clip is moved to."""

    capabilities: ClassVar[Capabilities] = Capabilities(needs_training=True, has_latent_space=True)
    frame_rate = CLIP.frame_rate
    skeleton = CLIP.skeleton

    def _fit(self, motions: tuple[Motion, ...]) -> None: ...

    def _sample(self, frames: int, count: int, seed: int, constraints: tuple, progress: Progress) -> list[Motion]:
        return self.decode(self.latents(count, seed), frames)

    def latents(self, count: int, seed: int = 0) -> np.ndarray:
        return np.random.default_rng(seed).normal(size=(count, 3))

    def mean_latent(self) -> np.ndarray:
        return np.full(3, 0.5)

    def decode(self, latents: np.ndarray, frames: int | None = None) -> list[Motion]:
        return [CLIP[:frames].replace(translations=CLIP.translations[:frames] + code) for code in latents]

    def invert(self, motion: Motion, seed: int = 0, progress: Progress | None = None) -> np.ndarray:
        assert progress is not None
        progress(1.0)
        return np.array((motion.translations - CLIP.translations[: len(motion)])[0, 0])


class Make:
    """Stands for the tab where the generator is chosen."""

    def __init__(self) -> None:
        self.frames, self.name, self._told = 10, "still", lambda: None

    @property
    def spec(self) -> Any:
        return SimpleNamespace(name=self.name, capabilities=Capabilities(has_latent_space=self.name != "still"))

    def on_choice(self, told: Any) -> None:
        self._told = told
        told()

    def choose(self, name: str) -> None:
        self.name = name
        self._told()

    def generator(self) -> Any:
        made: Generator = Jumping(None)
        return lambda: made

    def options(self) -> Any:
        return self.name


class Page:
    """A desk, the tab, and what is shown."""

    def __init__(self, queue: JobQueue, left: Belongings | None = None) -> None:
        self.client, self.make = Client(), Make()
        self.desk = Desk(self.client, queue, Limits())
        self.desk.keep("generator", lambda: self.make.name, self.make.choose)
        self.tab = LatentTab(self.desk, self.make)
        if left is None:
            self.desk.add_clip(CLIP.replace(translations=CLIP.translations + 7.0))
        else:
            self.desk.take_up(left)

    def fields(self, label: str) -> list[Any]:
        return [each for each in self.client.gui.handles if each.label == label and not each.removed]

    def wait(self) -> None:
        while jobs := list(self.desk.jobs):
            for job in jobs:
                assert job.wait(PATIENCE_SECONDS)

    def code(self) -> np.ndarray:
        """Of the motion that is shown."""
        self.wait()
        assert [said.body for said in self.client.said] == []
        (take,) = [take for take in self.desk.takes if not take.accepted]
        return (take.motion.translations - CLIP.translations[:10])[0, 0]


@pytest.fixture
def queue() -> Iterator[JobQueue]:
    made = JobQueue(PATIENCE_SECONDS)
    yield made
    made.close()


def test_codes_without_layers_can_be_moved() -> None:
    generator = Jumping(None)
    assert space_of(generator) == Space()
    one, other, mean = generator.latents(1, 3)[0], generator.latents(1, 4)[0], generator.mean_latent()
    here = code_of(generator, Place(seed=3, end_seed=4, share=0.25, coarse_layers=0, truncation=0.5), None, Space())
    np.testing.assert_allclose(here, mean + 0.5 * (0.75 * one + 0.25 * other - mean), rtol=1e-6)


def test_the_tab_has_what_the_generator_has(queue: JobQueue) -> None:
    page = Page(queue)
    (detail,), (more,) = page.fields("Detail of another seed"), page.fields("More or less of")
    about = next(each for each in page.client.gui.handles if each.kind == "html")
    assert about.visible
    page.make.choose("jumping")
    assert not about.visible
    np.testing.assert_allclose(page.code(), Jumping(None).latents(1, 0)[0], atol=1e-5)
    assert [detail.visible, more.visible] == [False, False]
    page.fields("Away from the mean")[0].move(0.0)
    np.testing.assert_allclose(page.code(), 0.5, atol=1e-5)
    page.make.choose("still")
    assert about.visible


def test_a_clip_is_inverted_for_one_generator(queue: JobQueue) -> None:
    page = Page(queue)
    page.make.choose("jumping")
    page.wait()
    page.fields("Invert the clip")[0].move()
    np.testing.assert_allclose(page.code(), 7.0, atol=1e-4)
    page.make.choose("jumping higher")
    page.wait()
    assert "press 'Invert the clip' first" in page.client.said[0].body


def test_a_motion_that_was_kept_does_not_come_again(queue: JobQueue) -> None:
    page = Page(queue)
    page.make.choose("jumping")
    page.wait()
    page.fields("Keep this motion")[0].move()
    again = Page(queue, page.desk.leave())
    again.wait()
    assert [take.accepted for take in again.desk.takes] == [True]
    again.fields("Away from the mean")[0].move(0.0)
    np.testing.assert_allclose(again.code(), 0.5, atol=1e-5)


def test_a_slider_that_is_moved_too_early_does_not_stop_the_loading(queue: JobQueue) -> None:
    page = Page(queue)
    with page.desk.lock:  # nothing that is loaded can be taken over meanwhile
        page.make.choose("jumping")
        page.fields("Away from the mean")[0].move(0.0)
    np.testing.assert_allclose(page.code(), 0.5, atol=1e-5)


def test_another_page_goes_on_at_the_same_place(queue: JobQueue) -> None:
    page = Page(queue)
    page.make.choose("jumping")
    page.wait()
    page.fields("Invert the clip")[0].move()
    page.wait()
    page.fields("Away from the mean")[0].move(1.5)
    before = page.code()
    again = Page(queue, page.desk.leave())
    np.testing.assert_allclose(again.code(), before, atol=1e-5)
    assert again.make.name == "jumping"
    assert again.fields("Start from")[0].value == "the clip"
