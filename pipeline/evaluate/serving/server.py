"""A policy server: one policy behind a WebSocket, for evaluators on this machine or with a token on others.

A client has `Limits.open_seconds` for the HTTP request and for its first message, and `idle_seconds` for every other one. Tokens
are checked before the WebSocket is opened, messages before anything is made from them. Whatever one client sends, the next is
served. GET /healthz answers OK.
"""

import asyncio
import hmac
import logging
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from http import HTTPStatus

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from pipeline.data.errors import DominoError
from pipeline.data.reading import printable
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.policies.policy import NoAnswer, Policy
from pipeline.evaluate.scenes.trial import INVALID_ACTION, NO_ANSWER
from pipeline.evaluate.serving.address import TOKEN, is_host, is_loopback
from pipeline.evaluate.serving.batching import Seat
from pipeline.evaluate.serving.session import Language, Session
from pipeline.evaluate.serving.wire import LARGEST, WireError, pack, unpack

BAD_MESSAGE, FAILED, BUSY = 1008, 1011, 1013
"""Close codes: the client's fault, the policy's, nobody's."""


class ServeError(DominoError):
    """A server that cannot be started."""


@dataclass(frozen=True)
class Limits:
    """`clients` are served at the same time, each by a policy or a seat of its own; a message has at most `largest` bytes."""

    clients: int = 1
    largest: int = LARGEST
    open_seconds: float = 10.0
    idle_seconds: float = 600.0


@dataclass(frozen=True)
class Place:
    """Where to listen; port 0 takes a free one. Other hosts than loopback need a token."""

    host: str = "127.0.0.1"
    port: int = 8765
    token: str | None = None

    def __post_init__(self) -> None:
        if not is_host(self.host):
            raise ServeError(f"--host {self.host!r} is no name of this machine and no IP address")
        if self.token is None and not is_loopback(self.host):
            raise ServeError(
                f"--host {self.host} can be reached from other machines: set {TOKEN} to a secret that clients must show"
            )
        if self.token is not None and len(self.token) < 16:
            raise ServeError(f"{TOKEN} has {len(self.token)} characters: use at least 16, e.g. of `openssl rand -hex 24`")


class PolicyServer:
    """Serves policies made by `make`, the first of them made before a port is opened, in a `language`."""

    def __init__(
        self,
        make: Callable[[], Policy],
        language: Language,
        place: Place,
        limits: Limits | None = None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._make, self._language, self._place, self._tell = make, language, place, tell
        self._limits = limits or Limits()
        self._free, self._places = [make()], asyncio.Semaphore(self._limits.clients)
        self.port = 0

    def run(self, started: Callable[[int], None] = lambda port: None) -> None:
        """Serve until SIGINT or SIGTERM. `started` is called with the port. Raises OSError if it cannot listen."""
        asyncio.run(self._run_until_signal(started))

    async def _run_until_signal(self, started: Callable[[int], None]) -> None:
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        await self.serve(stop, started)

    async def serve(self, stop: asyncio.Event, started: Callable[[int], None] = lambda port: None) -> None:
        """Serve until `stop` is set."""
        # a thread for each client: a question may wait for the others of its batch
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(self._limits.clients + 1))
        quiet = logging.Logger("domino.serving")
        quiet.addHandler(logging.NullHandler())
        async with serve(
            self._handle,
            self._place.host,
            self._place.port,
            # a page in a browser names its origin: none may reach a server on its user's machine
            origins=[None],
            compression=None,
            process_request=self._admit,
            server_header=None,
            open_timeout=self._limits.open_seconds,
            ping_interval=20,
            ping_timeout=60,
            close_timeout=2,
            max_size=self._limits.largest,
            max_queue=2,
            logger=quiet,
        ) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            started(self.port)
            await stop.wait()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """The refusal of a connection, or None to accept it."""
        path = request.path.partition("?")[0]
        if path == "/healthz":
            return connection.respond(HTTPStatus.OK, "OK\n")
        if path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "there is / and /healthz\n")
        if self._place.token is not None:
            shown = request.headers.get_all("Authorization")
            if not shown:
                return connection.respond(HTTPStatus.UNAUTHORIZED, f"this server wants a token: set {TOKEN}\n")
            scheme, _, secret = shown[0].partition(" ")
            same = hmac.compare_digest(secret.strip().encode(), self._place.token.encode())
            if scheme.lower() not in ("bearer", "api-key") or not same or len(shown) > 1:
                return connection.respond(HTTPStatus.UNAUTHORIZED, f"the token is wrong: set {TOKEN} to that of the server\n")
        return None

    async def _handle(self, connection: ServerConnection) -> None:
        """One client from its first to its last message."""
        try:
            # the last client may have left this very moment
            async with asyncio.timeout(min(2.0, self._limits.open_seconds)):
                await self._places.acquire()
        except TimeoutError:
            await self._end(connection, "busy: give evaluate --workers 1, start the server with more --clients, or try later", BUSY)
            return
        policy = None
        try:
            policy = self._free.pop() if self._free else await asyncio.to_thread(call_policy, self._make)
            await self._talk(connection, self._language.session(policy))
        except (ConnectionClosed, TimeoutError):
            return
        except DominoError as error:
            await self._end(connection, str(error), FAILED)
        finally:
            self._places.release()
            if isinstance(policy, Seat):
                policy.leave()
            if policy is not None:
                self._free.append(policy)

    async def _talk(self, connection: ServerConnection, session: Session) -> None:
        await self._send(connection, pack(session.greeting()))
        seconds = self._limits.open_seconds
        while True:
            try:
                async with asyncio.timeout(seconds):
                    data = await connection.recv()
            except TimeoutError:
                await self._end(connection, f"no whole message in {seconds:g} s", BAD_MESSAGE)
                return
            seconds = self._limits.idle_seconds
            try:
                answer = await asyncio.to_thread(call_policy, lambda data=data: self._answer(session, data))
            except WireError as error:
                return await self._end(connection, str(error), BAD_MESSAGE)
            except DominoError as error:
                return await self._end(connection, str(error), FAILED, fault_of(error))
            await self._send(connection, answer)

    def _answer(self, session: Session, data: bytes | str) -> bytes:
        return pack(session.answer(unpack(data, self._limits.largest)))

    async def _send(self, connection: ServerConnection, data: bytes | str) -> None:
        """Send, unless the client does not read. Raises TimeoutError then."""
        async with asyncio.timeout(self._limits.open_seconds):
            await connection.send(data)

    async def _end(self, connection: ServerConnection, reason: str, code: int, fault: str = "") -> None:
        # a reason may hold what an unknown client sent: no terminal and no log may obey it
        reason = printable(reason)
        self._tell(f"a client's connection ended: {reason}")
        try:
            await self._send(connection, self._language.error(reason, fault))
            # a close frame holds at most 123 bytes of reason
            await connection.close(code, reason.encode()[:120].decode(errors="ignore"))
        except (ConnectionClosed, TimeoutError):
            return


def fault_of(error: DominoError) -> str:
    """How an episode ends by an error of its policy; "" for a refusal."""
    return {ActionError: INVALID_ACTION, NoAnswer: NO_ANSWER}.get(type(error), "")


def call_policy[R](work: Callable[[], R]) -> R:
    """What the work returns. Raises NoAnswer for any error of a policy's code, so that it ends its client and not the server."""
    try:
        return work()
    except (DominoError, WireError):
        raise
    except BaseException as error:
        raise NoAnswer(line_of(error)) from error
