"""What of viser and websockets must be changed or looked into, so that a visitor can do no harm.

viser lets in everybody, believes what they say and opens a tunnel when one of them asks for it. Its server is made of
`websockets.asyncio.server.serve`, which it looks up when it starts: here another takes its place for that moment, which
asks the `Door` about every request and gives visitors a `VisitorConnection`, which drops all messages that the page
itself would not have sent.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import viser
import viser._messages as messages
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response
from websockets.protocol import State

from motiongen.web.door import Door, full, page_headers
from motiongen.web.limits import MEBIBYTE, Limits
from motiongen.web.screening import Uploads, fits, parse

MESSAGE_BYTES = MEBIBYTE
"""The largest message. The page sends files in parts of half that."""
MESSAGES_A_SECOND = 100.0
BURST = 200.0
"""How fast a visitor is listened to, in the long run and at once. A hand on a slider makes 20 messages a second."""
CALLBACKS_WAITING = 16
MESSAGES_WAITING = 256
"""How many callbacks of a visitor, and messages to them, may wait before they are listened to again."""

GOING_WRONG, TRY_LATER = 1002, 1013
"""Codes for closing a connection: 1002 makes viser's page show the reason and stop trying, after 1013 it tries on."""

_STARTING = threading.Lock()


class Guard:
    """A viser server that lets in only whom the door lets in.

    Attributes:
        viser: the server. It listens from the start.
    """

    def __init__(self, listener: socket.socket, door: Door, limits: Limits, label: str) -> None:
        """Start the server.

        Args:
            listener: the socket to listen on; viser itself would take the next port where one is in use.
            door: who may come in.
            limits: how many at once, and the size of files.
            label: title of the page.
        """
        self._listener, self._door, self._limits = listener, door, limits
        self._connections: set[ServerConnection] = set()
        self._serving = False
        with _STARTING, _silence(), _replaced(websockets.asyncio.server, "serve", self._serve):
            self.viser = viser.ViserServer(host="127.0.0.1", port=listener.getsockname()[1], label=label, verbose=False)
        if not self._serving:  # viser has changed, and everybody could come in
            self.stop()
            raise RuntimeError(f"viser {viser.__version__} does not start its server in the way that is guarded")

    def stop(self) -> None:
        """Send all visitors away and stop the server."""
        with _STARTING, _silence():
            self.viser.stop()

    def admit(self, client: viser.ClientHandle) -> str | None:
        """Begin to listen to a visitor whose page is there. Called in the server's event loop.

        Returns:
            The ticket that the door knows them by when they come again; None for no ticket.
        """
        # viser keeps connection and handle apart; this is the one place where they are under one number.
        connection = self.viser._websock_server._live_connections.get(client.client_id)
        if not isinstance(connection, VisitorConnection) or connection.request is None:
            return None
        connection.client = client
        # A thread of their own: otherwise whoever keeps viser's busy makes all others wait, and viser's are several, so
        # that what comes last may be dealt with first.
        client.gui._thread_executor = client.scene._thread_executor = connection.callbacks
        # A visit may still be drawn when its visitor has left; viser would warn of it on the terminal.
        client._websock_connection.get_message_buffer()._warned_push_after_done = True
        return self._door.ticket(connection.request.headers)

    def release(self, client: viser.ClientHandle) -> None:
        """Free the thread of a visitor who has left."""
        if isinstance(client.gui._thread_executor, CallbackThread):
            client.gui._thread_executor.shutdown(wait=False)

    def _serve(self, handler: Callable[..., Any], host: str, port: int, **settings: Any) -> serve:
        """Stands in for `websockets.asyncio.server.serve`: what viser asks for, on our terms."""
        self._serving = True
        return serve(
            partial(self._handle, handler),
            **{
                **settings,
                "sock": self._listener,  # in place of host and port
                "process_request": partial(self._process_request, settings["process_request"]),
                "create_connection": partial(VisitorConnection, limits=self._limits),
                "max_size": MESSAGE_BYTES,
                "close_timeout": 1.0,
                "logger": _quiet_logger(),
            },
        )

    def _process_request(
        self, inner: Callable[..., Response | None], connection: ServerConnection, request: Request
    ) -> Response | None:
        answer = self._door.answer(request.path, request.headers)
        if answer is None and len(self._connections) >= self._limits.visitors:
            answer = full(self._limits.visitors)
        if answer is None:
            response = inner(connection, request)
            headers = page_headers(request.headers["Host"])
            if self._door.ticket(request.headers) is None:
                headers["Set-Cookie"] = self._door.new_ticket()
        else:
            response = connection.respond(answer.status, answer.text)
            headers = {**page_headers(), **answer.headers}
        if response is not None:
            response.headers.update(headers)
        return response

    async def _handle(self, handler: Callable[..., Any], connection: ServerConnection) -> None:
        if connection.subprotocol != f"viser-v{viser.__version__}":  # viser would say so, with a line for the terminal
            await connection.close(GOING_WRONG, "This page is of another version; load it again")
        elif len(self._connections) >= self._limits.visitors:
            await connection.close(TRY_LATER, "All places are taken")
        else:
            self._connections.add(connection)
            try:
                await handler(connection)
            finally:
                self._connections.discard(connection)


class VisitorConnection(ServerConnection):
    """A connection on which only sound messages arrive, and no faster than they can be dealt with."""

    def __init__(self, *arguments: Any, limits: Limits, **settings: Any) -> None:
        """Take what `ServerConnection` takes, and the limits."""
        super().__init__(*arguments, **settings)
        self.client: viser.ClientHandle | None = None
        self.callbacks = CallbackThread()
        self._uploads = Uploads(limits.upload_bytes)
        self._credit, self._counted = BURST, self.loop.time()

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that is sound; viser reads all that comes by this."""
        while True:
            raw = await super().recv(decode)
            await self._keep_pace(len(raw))
            if self._lets_through(raw):
                return raw

    async def _keep_pace(self, size: int) -> None:
        """Wait where a visitor sends more than a hand can, faster than their callbacks end, or without reading."""
        now = self.loop.time()
        self._credit = min(BURST, self._credit + (now - self._counted) * MESSAGES_A_SECOND)
        self._credit -= 1 + size / (MESSAGE_BYTES / 4)
        self._counted = now
        # Even without a wait the others take their turn, and what came before is begun with and counts.
        await asyncio.sleep(max(0.0, -self._credit / MESSAGES_A_SECOND))
        while self._is_behind() and self.state is State.OPEN:
            await asyncio.sleep(0.02)

    def _is_behind(self) -> bool:
        if self.client is None:
            return False
        unsent = self.client._websock_connection.get_message_buffer().message_from_id
        return self.callbacks.waiting > CALLBACKS_WAITING or len(unsent) > MESSAGES_WAITING

    def _lets_through(self, raw: Any) -> bool:
        message = parse(raw)
        if message is None or isinstance(message, messages.ViewerCameraMessage):
            return message is not None
        if self.client is None:
            return False
        if isinstance(message, messages.GuiUpdateMessage):
            # viser takes any value for any property of a widget, whether it is shown as disabled or not.
            widget = self.client.gui._gui_input_handle_from_uuid.get(message.uuid)
            return widget is not None and message.updates.keys() == {"value"} and fits(widget, message.updates["value"])
        if isinstance(message, messages.FileTransferStartUpload):
            refusal = self._uploads.start(message)
            if refusal:
                self._refuse(self.client, message, refusal)
            return refusal is None
        if isinstance(message, messages.FileTransferPart):
            return self._uploads.takes(message)
        if isinstance(message, messages.ScenePointerMessage):
            ray = message.ray_origin is not None and message.ray_direction is not None
            return message.event_type == "click" and ray and len(message.screen_pos) == 1
        return True

    def _refuse(self, client: viser.ClientHandle, message: messages.FileTransferStartUpload, why: str) -> None:
        # The page shows a file on its way until it has heard that all of it is there.
        everything = messages.FileTransferPartAck(
            message.source_component_uuid, message.transfer_uuid, message.size_bytes, message.size_bytes
        )
        client._websock_connection.queue_message(everything)
        client.add_notification("File refused", why, color="red")


class CallbackThread(ThreadPoolExecutor):
    """One thread, which does everything in its turn and knows how much there is to do."""

    def __init__(self) -> None:
        """Do not start it yet."""
        super().__init__(max_workers=1, thread_name_prefix="visitor")
        self._futures: set[Future[Any]] = set()

    @property
    def waiting(self) -> int:
        """How many callbacks run or wait."""
        return len(self._futures)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **settings: Any) -> Future[Any]:
        """Have a function called."""
        future = super().submit(function, *arguments, **settings)
        self._futures.add(future)
        future.add_done_callback(self._futures.discard)
        return future


def _quiet_logger() -> logging.Logger:
    """A logger that tells of our own failures alone: websockets tells of every request, with the token in its path."""
    logger = logging.getLogger("motiongen.web")
    logger.setLevel(logging.ERROR)
    if not logger.filters:
        logger.addFilter(lambda record: record.getMessage() != "opening handshake failed")  # theirs
    return logger


@contextmanager
def _silence() -> Iterator[None]:
    """Viser announces its beginning and its end with `rich.print`, whatever it is told."""
    import rich

    with _replaced(rich, "print", lambda *_, **__: None):
        yield


@contextmanager
def _replaced(owner: Any, name: str, value: Any) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)
