"""A client's end of a WebSocket: waits are limited, failures are one line."""

import asyncio
import threading
from collections.abc import Coroutine, Mapping
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.frames import CloseCode

from pipeline.data.errors import DominoError
from pipeline.data.reading import printable
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.policy import NoAnswer, PolicyError

from .messages import BUSY, INVALID, LARGEST, REFUSED

CONNECT_SECONDS = 10.0
GREETING_SECONDS = 60.0  # for the first message: a server may load a policy for it
CLOSE_SECONDS = 2.0


class ConnectionLost(NoAnswer): ...


class Unreachable(PolicyError): ...


def fault_of(reason: str, code: int | None) -> DominoError:
    kinds = {INVALID: ActionError, REFUSED: PolicyError, BUSY: Unreachable}
    return kinds.get(code or 0, NoAnswer)(reason)


class WebSocket:
    """A thread also answers pings. Raises Unreachable, and PolicyError for a refusal."""

    def __init__(self, url: str, headers: Mapping[str, str] | None = None) -> None:
        self.url, self._headers, self._closed = url, dict(headers or {}), False
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._run, daemon=True).start()
        self._connection: ClientConnection | None = None
        try:
            self._connection = self._within(2 * CONNECT_SECONDS, self._open())
        except InvalidStatus as error:
            self.close()
            reason = last_line(bytes(error.response.body or b"").decode(errors="replace"))
            raise PolicyError(f"{url}: refused ({error.response.status_code}): {reason}") from error
        # ValueError: no name of a host
        except (OSError, TimeoutError, WebSocketException, ValueError) as error:
            self.close()
            reason = last_line(str(error)) or type(error).__name__
            raise Unreachable(f"{url}: cannot be reached: {reason}") from error

    def greet(self) -> bytes:
        return self.ask(None, GREETING_SECONDS)

    def close(self) -> None:
        connection, self._connection = self._connection, None
        if self._closed:
            return
        self._closed = True

        async def end() -> None:
            if connection is not None:
                await connection.close()
            self._loop.stop()

        asyncio.run_coroutine_threadsafe(end(), self._loop)

    def _run(self) -> None:
        self._loop.run_forever()
        self._loop.close()

    async def _open(self) -> ClientConnection:
        # no compression: a small message cannot become a large one; no proxy; no pings of ours: a
        # server that computes may not answer them; an explicit host: a server cannot send us on
        # to another one
        return await connect(
            self.url,
            host=urlsplit(self.url).hostname,
            additional_headers=self._headers,
            compression=None,
            proxy=None,
            open_timeout=CONNECT_SECONDS,
            ping_interval=None,
            close_timeout=CLOSE_SECONDS,
            max_size=LARGEST,
        )

    def ask(self, data: bytes | None, seconds: float) -> bytes:
        """Send a message and return the answer. Raises ConnectionLost, NoAnswer and `fault_of`."""
        if self._connection is None:
            raise ConnectionLost(f"{self.url}: the connection is closed")
        try:
            answer = self._within(seconds, self._send_and_receive(self._connection, data))
        except ConnectionClosed as error:
            self.close()
            sent = error.sent
            if sent and not error.rcvd_then_sent and sent.code == CloseCode.MESSAGE_TOO_BIG:
                large = f"{self.url}: the answer has more than {LARGEST} bytes"
                raise ActionError(large) from error
            why = last_line(error.rcvd.reason if error.rcvd else str(error)) or "no reason given"
            raise ConnectionLost(f"{self.url}: the server closed the connection: {why}") from error
        except TimeoutError as error:
            self.close()
            raise NoAnswer(f"{self.url}: no answer in {seconds:.3g} s") from error
        if isinstance(answer, bytes):
            return answer
        reason, code = answer
        self.close()
        prefix = "the server failed: " if code in (None, CloseCode.INTERNAL_ERROR) else ""
        raise fault_of(f"{self.url}: {prefix}{last_line(reason)}", code)

    async def _send_and_receive(
        self, connection: ClientConnection, data: bytes | None
    ) -> bytes | tuple[str, int | None]:
        if data is not None:
            await connection.send(data)
        answer = await connection.recv()
        if isinstance(answer, bytes):
            return answer
        try:
            async with asyncio.timeout(CLOSE_SECONDS):
                await connection.wait_closed()
        except TimeoutError:
            return answer, None
        return answer, connection.close_code

    def _within[T](self, seconds: float, work: Coroutine[Any, Any, T]) -> T:
        limited = asyncio.wait_for(work, seconds)
        return asyncio.run_coroutine_threadsafe(limited, self._loop).result()


def last_line(text: str) -> str:
    """The last line that is not empty: of a traceback, what was raised."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return printable(lines[-1][:500]) if lines else ""
