"""A client's end of a WebSocket: every failure is an error of one line that names the server."""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from socket import SHUT_RDWR
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.frames import CloseCode
from websockets.sync.client import connect

from pipeline.data.reading import printable
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.policy import NoAnswer, PolicyError
from pipeline.evaluate.serving.wire import LARGEST, WireError, pack, unpack

CONNECT_SECONDS = 10.0
ANSWER_SECONDS = 300.0
"""What sending a question may take, and what its answer may take: the first one often compiles a model."""

REOPEN_SECONDS = 30.0
"""How long a server that answered before may be away."""


class Lost(NoAnswer):
    """The connection ended."""


class Unreachable(PolicyError):
    """There is no server."""


def retry_connect[T](connect: Callable[[], T], seconds: float = REOPEN_SECONDS) -> T:
    """What `connect` returns, tried again until `seconds` have passed: a server may be started again. Raises Unreachable."""
    until = time.monotonic() + seconds
    while True:
        try:
            return connect()
        except Unreachable:
            if time.monotonic() > until:
                raise
            time.sleep(0.2)


class Socket:
    """An open connection. Raises Unreachable if there is no server, PolicyError if it refuses."""

    def __init__(self, url: str, headers: Mapping[str, str] | None = None) -> None:
        self.url, self._cut_off = url, False
        self._stack = ExitStack()
        try:
            # no compression: a small message cannot become a large one; no proxy; answers have a time limit of their own
            self._socket = self._stack.enter_context(
                connect(
                    url,
                    additional_headers=dict(headers or {}),
                    compression=None,
                    proxy=None,
                    open_timeout=CONNECT_SECONDS,
                    ping_interval=None,
                    close_timeout=2,
                    max_size=LARGEST,
                )
            )
        except InvalidStatus as error:
            reason = _line(bytes(error.response.body or b"").decode(errors="replace"))
            raise PolicyError(f"{url}: refused ({error.response.status_code}): {reason}") from error
        except (OSError, TimeoutError, WebSocketException) as error:
            raise Unreachable(f"{url}: cannot be reached: {_line(str(error)) or type(error).__name__}") from error

    def ask(self, message: Mapping[str, Any], seconds: float = ANSWER_SECONDS) -> dict[Any, Any]:
        """Send a message and wait for the answer."""
        self.send(message)
        return self.receive(seconds)

    def send(self, message: Mapping[str, Any], seconds: float = ANSWER_SECONDS) -> None:
        """Send a message. Raises Lost if the connection has ended, NoAnswer if the server does not read it in time."""
        watch = threading.Timer(seconds, self._cut)
        watch.daemon = True
        watch.start()
        try:
            self._socket.send(pack(message))
        except ConnectionClosed as error:
            if self._cut_off:
                raise NoAnswer(f"{self.url}: the server has read nothing for {seconds:g} s") from error
            raise Lost(f"{self.url}: the server closed the connection: {_describe_closing(error)}") from error
        finally:
            watch.cancel()

    def receive(self, seconds: float = ANSWER_SECONDS) -> dict[Any, Any]:
        """The next message.

        Raises Lost if the connection has ended, NoAnswer if nothing arrives in time or the server reports an error,
        ActionError for a message that cannot be used.
        """
        try:
            data = self._socket.recv(timeout=seconds)
        except ConnectionClosed as error:
            if error.sent and not error.rcvd_then_sent and error.sent.code == CloseCode.MESSAGE_TOO_BIG:
                raise ActionError(f"{self.url}: the answer has more than {LARGEST} bytes") from error
            raise Lost(f"{self.url}: the server closed the connection: {_describe_closing(error)}") from error
        except TimeoutError as error:
            self.close()
            raise NoAnswer(f"{self.url}: no answer in {seconds:g} s") from error
        if isinstance(data, str):
            self.close()
            raise NoAnswer(f"{self.url}: the server failed: {_line(data)}")
        try:
            return unpack(data)
        except WireError as error:
            self.close()
            raise ActionError(f"{self.url}: {error}") from error

    def _cut(self) -> None:
        """End the connection under a `send` that waits."""
        self._cut_off = True
        with suppress(OSError):
            self._socket.socket.shutdown(SHUT_RDWR)

    def close(self) -> None:
        """Close the connection."""
        self._stack.close()


def _describe_closing(error: ConnectionClosed) -> str:
    return _line(error.rcvd.reason if error.rcvd else str(error)) or "no reason given"


def _line(text: str) -> str:
    """The last line of a text that says something: of a traceback, what was raised."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return printable(lines[-1][:500]) if lines else ""
