"""One policy behind a WebSocket. Errors are sent as text before the close."""

import asyncio
import hmac
import logging
import re
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
from pipeline.evaluate.policies.policy import Policy

from .address import TOKEN, is_loopback
from .batching import Seat
from .messages import BUSY, LARGEST, REFUSED, pack
from .session import ServerOptions, Session, guarded, respond


class ServeError(DominoError): ...


@dataclass(frozen=True)
class ServerLimits:
    """The HTTP request and the first message have `open_seconds`, others `idle_seconds`."""

    clients: int = 1
    open_seconds: float = 10.0
    idle_seconds: float = 600.0


@dataclass(frozen=True)
class ServerAddress:
    """Port 0 takes a free one. Not loopback: a token."""

    host: str = "127.0.0.1"
    port: int = 8765
    token: str | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_.:%-]{1,253}", self.host, re.ASCII):
            raise ServeError(f"--host {self.host!r} is no name of this machine and no IP address")
        if self.token is None and not is_loopback(self.host):
            reached = f"--host {self.host} can be reached from other machines"
            raise ServeError(f"{reached}: set {TOKEN} to a secret that clients must show")
        if self.token is not None and len(self.token) < 16:
            count = len(self.token)
            raise ServeError(f"{TOKEN} has {count} characters: use at least 16")


class PolicyServer:
    """The first of its policies is made before a port is opened."""

    def __init__(
        self,
        make: Callable[[], Policy],
        options: ServerOptions,
        address: ServerAddress,
        limits: ServerLimits | None = None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._make, self._options, self._address, self._tell = make, options, address, tell
        self._limits = limits or ServerLimits()
        self._free, self._places = [make()], asyncio.Semaphore(self._limits.clients)
        self.port = 0

    def run(self, started: Callable[[int], None] = lambda port: None) -> None:
        """Serve until SIGINT or SIGTERM; `started` gets the port. Raises OSError."""

        async def until_signal() -> None:
            stop, loop = asyncio.Event(), asyncio.get_running_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, stop.set)
            await self.serve(stop, started)

        asyncio.run(until_signal())

    async def serve(
        self, stop: asyncio.Event, started: Callable[[int], None] = lambda port: None
    ) -> None:
        # a thread for each client: a question may wait for the others of its batch
        threads = ThreadPoolExecutor(self._limits.clients + 1)
        asyncio.get_running_loop().set_default_executor(threads)
        quiet = logging.Logger("domino.serving")
        quiet.addHandler(logging.NullHandler())
        async with serve(
            self._handle,
            self._address.host,
            self._address.port,
            # a page in a browser names its origin: none may reach a server on its user's machine
            origins=[None],
            compression=None,
            process_request=self._admit,
            server_header=None,
            open_timeout=self._limits.open_seconds,
            ping_interval=20,
            ping_timeout=60,
            close_timeout=2,
            max_size=LARGEST,
            max_queue=2,
            logger=quiet,
        ) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            started(self.port)
            await stop.wait()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        path = request.path.partition("?")[0]
        if path == "/healthz":
            return connection.respond(HTTPStatus.OK, "OK\n")
        if path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "there is / and /healthz\n")
        if self._address.token is None:
            return None
        shown = request.headers.get_all("Authorization")
        scheme, _, secret = (shown or [""])[0].partition(" ")
        same = hmac.compare_digest(secret.strip().encode(), self._address.token.encode())
        if scheme.lower() in ("bearer", "api-key") and same and len(shown) == 1:
            return None
        what = "the token is wrong" if shown else "this server wants a token"
        return connection.respond(HTTPStatus.UNAUTHORIZED, f"{what}: set {TOKEN}\n")

    async def _handle(self, connection: ServerConnection) -> None:
        policy = None
        try:
            # the last client may have left this very moment
            async with asyncio.timeout(min(2.0, self._limits.open_seconds)):
                await self._places.acquire()
        except TimeoutError:
            busy = "busy: give evaluate --workers 1, start the server with more --clients, or wait"
            return await self._end(connection, busy, BUSY)
        try:
            made = self._free.pop() if self._free else await asyncio.to_thread(guarded, self._make)
            if isinstance(made, tuple):
                return await self._end(connection, *made)
            policy = made
            ending = await self._talk(connection, Session(policy, self._options))
            await self._end(connection, *ending)
        except (ConnectionClosed, TimeoutError):
            return
        finally:
            self._places.release()
            if isinstance(policy, Seat):
                policy.leave()
            if policy is not None:
                self._free.append(policy)

    async def _talk(self, connection: ServerConnection, session: Session) -> tuple[str, int]:
        answer = guarded(lambda: pack(session.metadata()))
        seconds = self._limits.open_seconds
        while isinstance(answer, bytes):
            # a client that does not read loses its place
            async with asyncio.timeout(self._limits.open_seconds):
                await connection.send(answer)
            try:
                async with asyncio.timeout(seconds):
                    data = await connection.recv()
            except TimeoutError:
                return f"no whole message in {seconds:g} s", REFUSED
            seconds = self._limits.idle_seconds
            answer = await asyncio.to_thread(respond, session, data)
        return answer

    async def _end(self, connection: ServerConnection, reason: str, code: int) -> None:
        # a reason may hold what an unknown client sent: no terminal and no log may obey it
        reason = printable(reason)
        self._tell(f"a client's connection ended: {reason}")
        try:
            async with asyncio.timeout(self._limits.open_seconds):
                await connection.send(reason)
                # a close frame holds at most 123 bytes of reason
                await connection.close(code, reason.encode()[:120].decode(errors="ignore"))
        except (ConnectionClosed, TimeoutError):
            return
