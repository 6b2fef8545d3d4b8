"""A client's end of a WebSocket: every failure is a PolicyError of one line that names the server."""

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import connect

from pipeline.evaluate.policy import PolicyError
from pipeline.evaluate.serving.wire import LARGEST, WireError, pack, unpack

CONNECT_SECONDS = 10.0
ANSWER_SECONDS = 300.0
"""What one answer may take: the first one often compiles a model."""


class Lost(PolicyError):
    """The connection ended."""


class Socket:
    """An open connection. Raises PolicyError where the server cannot be reached or refuses."""

    def __init__(self, url: str, headers: Mapping[str, str] | None = None) -> None:
        self.url = url
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
            raise PolicyError(f"{url}: cannot be reached: {_line(str(error)) or type(error).__name__}") from error

    def ask(self, message: Mapping[str, Any], seconds: float = ANSWER_SECONDS) -> dict[Any, Any]:
        """Send a message and wait for the answer."""
        self.send(message)
        return self.receive(seconds)

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message. Raises Lost where the connection has ended."""
        try:
            self._socket.send(pack(message))
        except ConnectionClosed as error:
            raise Lost(f"{self.url}: the server closed the connection: {_closed(error)}") from error

    def receive(self, seconds: float = ANSWER_SECONDS) -> dict[Any, Any]:
        """The next message. Raises Lost where the connection has ended, PolicyError where nothing or no message arrives."""
        try:
            data = self._socket.recv(timeout=seconds)
        except ConnectionClosed as error:
            raise Lost(f"{self.url}: the server closed the connection: {_closed(error)}") from error
        except TimeoutError as error:
            self.close()
            raise PolicyError(f"{self.url}: no answer in {seconds:g} s") from error
        if isinstance(data, str):
            self.close()
            raise PolicyError(f"{self.url}: the server failed: {_line(data)}")
        try:
            return unpack(data)
        except WireError as error:
            self.close()
            raise PolicyError(f"{self.url}: {error}") from error

    def close(self) -> None:
        """Close the connection."""
        self._stack.close()


def _closed(error: ConnectionClosed) -> str:
    return _line(error.rcvd.reason if error.rcvd else str(error)) or "no reason given"


def _line(text: str) -> str:
    """The last line of a text that says something: of a traceback, what was raised."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:500] if lines else ""
