"""What a visitor of `motiongen serve` costs the server: `python -m tools.bench_serve [CLIP] [--limits]`.

The page plays a clip beside two copies of it to visitors without browsers, who only take what is sent. Beside it, what
one frame of the stage costs before anything is sent, and the same written out plainly: a node for each bone, placed
from the pose of the moment. With `--limits`, how long work at the usual limits goes on that nobody can stop: a job ends
when it next tells how far it is.
"""

from __future__ import annotations

import argparse
import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed

import motiongen as mg
from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.web.clip_tab import example_clip
from motiongen.web.limits import Limits
from motiongen.web.server import Server
from motiongen.web.stage import Actor, Stage
from motiongen.web.visit import Visit
from motiongen.web.wishes import Take, Wish, make_takes
from tests.web.scenes import Client
from tests.web.wire import visitor

FRAMES, SECONDS = 300, 10.0


class Three(Visit):
    """A visit with a clip of ours and two takes on its stage."""

    clip: mg.Motion

    def __init__(self, *arguments: object) -> None:
        """Put them there."""
        super().__init__(*arguments)
        with self._desk.lock:
            self._desk.remove_clip()
            self._desk.add_clip(self.clip)
            self._desk.show_takes([Take(self.clip, "one"), Take(self.clip, "two")])


class Plain:
    """The stage's frames without what makes them cheap: every bone is a node, and every pose is computed when asked."""

    def __init__(self, client: Client, clip: mg.Motion) -> None:
        """Make the nodes."""
        self._clip, self._ground = clip, kinematics.ground_height(clip)
        joints = range(1, len(clip.skeleton))
        self._bones = [client.scene.add_frame(f"/bone{joint}") for joint in joints]
        self._rest = np.array([0.0, 1.0, 0.0])

    def move_to(self, seconds: float) -> None:
        """Place every bone."""
        clip = self._clip
        pose = clip[min(round(seconds * clip.frame_rate), len(clip) - 1)]
        places = pose.positions[0] - [0.0, self._ground, 0.0]
        for joint, bone in enumerate(self._bones, start=1):
            start, end = places[clip.skeleton.parents[joint]], places[joint]
            bone.position = start
            bone.wxyz = turned(self._rest, end - start)[[3, 0, 1, 2]]


def turned(rest: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4,) the quaternion xyzw that turns one direction into another."""
    length = np.linalg.norm(along)
    if length == 0:
        return rot.IDENTITY
    axis = np.cross(rest, along / length)
    size = np.linalg.norm(axis)
    angle = np.arctan2(size, rest @ along / length)
    return rot.from_axis_angle(axis / size if size > 0 else np.array([1.0, 0.0, 0.0]), angle)


def frame_seconds(move_to: Callable[[float], None]) -> float:
    """The median time of a frame, 30 a second."""
    times = []
    for frame in range(FRAMES):
        begun = time.perf_counter()
        move_to(frame / 30)
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


@contextlib.contextmanager
def listening(server: Server, counts: list[int]) -> Iterator[None]:
    """A visitor who takes what is sent, and counts its bytes."""
    with visitor(server) as connection:

        def take() -> None:
            with contextlib.suppress(ConnectionClosed):
                while True:
                    counts.append(len(connection.recv()))

        threading.Thread(target=take, daemon=True).start()
        yield


def server_load(visitors: int) -> tuple[float, float]:
    """Share of a processor of server and listeners together, and kilobytes a second for each visitor."""
    with Server(port=0, visit=Three) as server, contextlib.ExitStack() as stack:
        counts: list[int] = []
        for _ in range(visitors):
            stack.enter_context(listening(server, counts))
        time.sleep(5.0)  # the pages are built
        counts.clear()
        begun = time.process_time()
        time.sleep(SECONDS)
        return (time.process_time() - begun) / SECONDS, sum(counts) / SECONDS / 1e3 / visitors


def unstoppable_seconds(clip: mg.Motion, clips: int) -> tuple[float, float, float]:
    """Of the most frames from clips of the most frames: seconds of `fit`, between two calls of progress, and in all."""
    limits = Limits()
    frames = np.arange(limits.frames) % len(clip)
    long = clip.replace(rotations=clip.rotations[frames], translations=clip.translations[frames])
    moments = [time.perf_counter()]
    generator = mg.create("genmm").fit([long.replace(name=str(number)) for number in range(clips)])
    moments.append(time.perf_counter())
    make_takes(generator, long, Wish(limits.frames), limits, lambda share: moments.append(time.perf_counter()))
    waits = np.diff([*moments, time.perf_counter()])
    return waits[0], waits[1:].max(), waits.sum()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_serve", description=__doc__)
    parser.add_argument("clip", nargs="?", help="a clip in place of the bundled one")
    parser.add_argument("--limits", action="store_true", help="only how long work cannot be stopped, at the limits")
    options = parser.parse_args()
    clip = mg.load(options.clip) if options.clip else example_clip()
    print(f"{clip.name}: {len(clip)} frames, {len(clip.skeleton)} joints\n")
    if options.limits:
        print("| clips learnt from | learning, s | longest step, s | in all, s |\n| ---: | ---: | ---: | ---: |")
        for clips in (1, Limits().clips):
            print(f"| {clips} | " + " | ".join(f"{each:.1f}" for each in unstoppable_seconds(clip, clips)) + " |")
        return
    print("| on the stage | ms a frame | plainly | ratio |\n| --- | ---: | ---: | ---: |")
    for count in (1, 2, 4):
        stage = Stage(Client())
        stage.show([Actor(clip, str(number), number == 0) for number in range(count)])
        ours = frame_seconds(stage.move_to)
        plain = count * frame_seconds(Plain(Client(), clip).move_to)
        print(f"| {count} | {1e3 * ours:.2f} | {1e3 * plain:.2f} | {plain / ours:.0f} |")
    Three.clip = clip
    print("\n| visitors | share of a processor | kB/s for each |\n| ---: | ---: | ---: |")
    for visitors in (1, 4, 8):
        share, kilobytes = server_load(visitors)
        print(f"| {visitors} | {share:.0%} | {kilobytes:.0f} |")


if __name__ == "__main__":
    main()
