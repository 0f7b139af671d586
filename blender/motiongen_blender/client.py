"""The other end of the pipe: `motiongen worker` as a process, talked to in lines of JSON.

No Blender in here. A thread reads what the worker says, so that nobody waits for it; `poll` hands it over.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import Any

PROTOCOL = 1
ENDED = "ended"
"""The type of the last message: the worker is no more."""


class WorkerError(Exception):
    """The worker cannot be found, started or understood; says what to do."""


def find_command(chosen: str = "") -> str:
    """The path of the `motiongen` program: the one chosen, or one found on PATH, in ~/.local/bin or in a `.venv` near.

    Raises:
        WorkerError: if there is none.
    """
    if chosen:
        path = Path(chosen).expanduser()
        if not path.is_file():
            raise WorkerError(f"there is no file '{path}'; set the path of motiongen in the add-on's preferences")
        return str(path)
    name, folder = ("motiongen.exe", "Scripts") if sys.platform == "win32" else ("motiongen", "bin")
    if found := shutil.which("motiongen"):
        return found
    near = [parent / venv / folder for parent in Path(__file__).resolve().parents for venv in (".venv", "venv")]
    for place in (Path.home() / ".local" / "bin", *near):
        if (place / name).is_file():
            return str(place / name)
    raise WorkerError(
        "motiongen is not found: install it in an environment of its own (pipx install motiongen), "
        "or set its path in the add-on's preferences"
    )


class Worker:
    """A running `motiongen worker`."""

    def __init__(self, command: str) -> None:
        """Start it.

        Raises:
            WorkerError: if it does not start.
        """
        # Blender's own Python settings would lead another Python astray.
        clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONHOME", "PYTHONPATH")}
        hidden = {"creationflags": 0x08000000} if sys.platform == "win32" else {}  # CREATE_NO_WINDOW
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        try:
            self._process = subprocess.Popen([command, "worker"], env=clean, **pipes, **hidden)
        except OSError as error:
            raise WorkerError(f"'{command}' does not start: {error}") from error
        self._inbox: queue.Queue[dict[str, Any]] = queue.Queue()
        self._outbox: queue.Queue[bytes | None] = queue.Queue()
        self._complaints: deque[str] = deque(maxlen=20)
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._complain, self._listen, self._speak)
        ]
        self._last_id = 0
        for thread in self._threads:
            thread.start()

    @property
    def alive(self) -> bool:
        """Whether it can still be asked."""
        return self._process.poll() is None

    def ask(self, kind: str, **fields: Any) -> int:
        """Send a request; returns the id that its answers carry. Does not wait for the pipe to take it."""
        self._last_id += 1
        request = {"id": self._last_id, "type": kind, **fields}
        self._outbox.put(json.dumps(request, allow_nan=False).encode("ascii") + b"\n")
        return self._last_id

    def poll(self, timeout: float = 0.0) -> list[dict[str, Any]]:
        """What it has said since the last time; waits up to `timeout` seconds where that is nothing."""
        messages = []
        try:
            messages.append(self._inbox.get(timeout=timeout) if timeout else self._inbox.get_nowait())
            while True:
                messages.append(self._inbox.get_nowait())
        except queue.Empty:
            return messages

    def stop(self) -> None:
        """End it, whatever it is doing."""
        self._outbox.put(None)
        if self.alive:
            self._process.terminate()
            try:
                self._process.wait(timeout=2)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for thread in self._threads:
            thread.join(timeout=2)
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe:
                pipe.close()

    # -- the threads

    def _listen(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            try:
                message = json.loads(line)
            except ValueError:
                self._complaints.append(line.decode("utf-8", "replace").strip())
                continue
            if message.get("type") == "hello" and message.get("protocol") != PROTOCOL:
                theirs = message.get("protocol")
                text = f"motiongen speaks protocol {theirs}, this add-on {PROTOCOL}; bring both to the same version"
                self._inbox.put({"type": ENDED, "id": None, "message": text})
                self._process.terminate()
                return
            self._inbox.put(message)
        self._process.wait()
        self._threads[0].join(timeout=2)  # its last words come before its end
        last = self._complaints[-1] if self._complaints else f"exit code {self._process.returncode}"
        self._inbox.put({"type": ENDED, "id": None, "message": f"motiongen has stopped: {last}"})

    def _speak(self) -> None:
        assert self._process.stdin
        try:
            with self._process.stdin as pipe:
                while (line := self._outbox.get()) is not None:
                    pipe.write(line)
                    pipe.flush()
        except OSError:
            pass  # it has gone; the listener says so

    def _complain(self) -> None:
        assert self._process.stderr
        for line in self._process.stderr:
            if text := line.decode("utf-8", "replace").strip():
                self._complaints.append(text)
