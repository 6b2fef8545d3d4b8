"""A policy on a server that speaks this project's protocol: --policy ws://HOST:PORT or wss://HOST:PORT."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.errors import DominoError
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.contract import difference, mismatch, served
from pipeline.evaluate.policies.policy import NoAnswer, Observation, Policy, PolicyError, PolicyName, Start, chunk_of
from pipeline.evaluate.scenes.trial import INVALID_ACTION, NO_ANSWER
from pipeline.evaluate.serving.address import Address, parse_address, token
from pipeline.evaluate.serving.session import PROTOCOL, VERSION, contract_of, setup_keys, text
from pipeline.evaluate.serving.socket import ANSWER_SECONDS, CONNECT_SECONDS, Lost, Socket, retry_connect
from pipeline.evaluate.serving.wire import WireError

SCHEMES = ("ws", "wss")
FAULTS: dict[str, type[DominoError]] = {INVALID_ACTION: ActionError, NO_ANSWER: NoAnswer}
"""What a server's error is here, by its `fault`."""


class Occupied(PolicyError):
    """The server has no place for another client."""


class Channel(Protocol):
    """What carries messages to a policy and back. Every failure is a PolicyError or an ActionError."""

    def ask(self, message: Mapping[str, Any]) -> dict[Any, Any]:
        """Send a message and wait for the answer. Raises Lost if the connection has ended."""
        ...

    def receive(self, seconds: float, /) -> dict[Any, Any]:
        """The next message."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


class Client(ABC):
    """A policy behind this project's protocol. The connection is opened at the first reset, and again where it was lost between
    episodes. `prefix` begins the messages of its errors."""

    refusal: type[PolicyError] = PolicyError
    """What a connection raises that begins with an error."""

    def __init__(self, prefix: str) -> None:
        self._prefix, self._length = prefix, 0
        self._socket: Channel | None = None
        self._greeted: tuple[object, ...] | None = None
        self.inferences: object = None

    @abstractmethod
    def _connect(self) -> Channel:
        """Open a connection. Raises PolicyError."""

    def _fail(self) -> None:
        """The policy answered a question with an error."""
        self.close()

    def reset(self, start: Start) -> None:
        """Greet the server, once for all episodes of one robot, and begin an episode. Raises PolicyError."""
        same = (start.embodiment, start.action_names, start.setup, tuple(start.image_sizes.items()))
        if self._socket is not None and same == self._greeted:
            try:
                return self._begin(self._socket, start)
            except Lost:
                self._socket.close()
        elif self._socket is not None:
            self._socket.close()
        self._socket, self._greeted = None, None
        socket, offer = self._open_again() if self._length else self._open()
        try:
            self._greet(socket, offer, start)
            self._begin(socket, start)
        except DominoError:
            socket.close()
            raise
        self._socket, self._greeted, self._length = socket, same, len(start.action_names)

    def act(self, observation: Observation) -> ArrayLike:
        """Ask for a chunk. Raises PolicyError."""
        if self._socket is None:
            raise PolicyError(f"{self._prefix}asked before reset")
        message = {
            "type": "act",
            "time": observation.time,
            "joints": np.asarray(observation.joints, np.float64),
            "images": dict(observation.images),
        }
        if observation.depth:
            message["depth"] = dict(observation.depth)
        if observation.segmentation:
            message["segmentation"] = dict(observation.segmentation)
        if observation.pointcloud is not None:
            message["pointcloud"] = observation.pointcloud
        if observation.committed is not None and len(observation.committed):
            message["committed"] = np.asarray(observation.committed, np.float64)
        try:
            told = self._socket.ask(message)
        except DominoError:
            self.close()
            raise
        try:
            self._expect(told, "actions")
        except DominoError:
            self._fail()
            raise
        answer, self.inferences = told.get("actions"), told.get("inferences")
        if not isinstance(answer, np.ndarray):
            raise ActionError(f"{self._prefix}actions is a {type(answer).__name__}, not an array")
        return chunk_of(answer, self._length)

    def close(self) -> None:
        """End the connection."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._greeted = None, None

    def _open_again(self) -> tuple[Channel, dict[object, object]]:
        """As `_open`, after the connection was lost."""
        return self._open()

    def _open(self) -> tuple[Channel, dict[object, object]]:
        socket = self._connect()
        try:
            offer = socket.receive(CONNECT_SECONDS)
            if offer.get("type") == "error":
                raise self.refusal(f"{self._prefix}{line_of_text(offer.get('reason'))}")
            if offer.get("protocol") != PROTOCOL:
                raise PolicyError(
                    f"{self._prefix}speaks another protocol: give openpi://HOST:PORT or starvla://HOST:PORT for theirs"
                )
            if offer.get("version") != VERSION:
                raise PolicyError(
                    f"{self._prefix}protocol version: the server speaks {str(offer.get('version'))[:20]}, this client {VERSION}"
                )
        except DominoError:
            socket.close()
            raise
        return socket, offer

    def _greet(self, socket: Channel, offer: dict[object, object], start: Start) -> None:
        given = served(start)
        try:
            reason = mismatch(contract_of(offer.get("contract")), given)
            reason = reason or difference(setup_keys(offer.get("setup", {})), start.setup)
        except WireError as error:
            raise PolicyError(f"{self._prefix}{error}") from error
        if reason:
            raise PolicyError(f"{self._prefix}{reason}")
        hello = {
            "type": "hello",
            "version": VERSION,
            "embodiment": start.embodiment,
            "action_names": list(given.action_names),
            "rate": given.rate,
            "image_sizes": {name: list(size) for name, size in given.image_sizes.items()},
            "chunk": given.chunk,
            "normalization": given.normalization,
            "setup": start.setup.given(),
        }
        self._expect(socket.ask(hello), "welcome")

    def _begin(self, socket: Channel, start: Start) -> None:
        self._expect(socket.ask({"type": "reset", "instruction": start.instruction, "seed": start.seed}), "ready")

    def _expect(self, message: dict[object, object], kind: str) -> dict[object, object]:
        """The message, if it is of this kind. Raises PolicyError with the server's reason, or for another kind."""
        if message.get("type") == "error":
            reason, fault = line_of_text(message.get("reason")), FAULTS.get(str(message.get("fault")))
            # the policy's own fault reads as in one process, wherever the policy is
            raise PolicyError(f"{self._prefix}{reason}") if fault is None else fault(reason)
        if message.get("type") != kind:
            raise PolicyError(f"{self._prefix}answered {str(message.get('type'))[:40]!r} instead of {kind!r}")
        return message


class Remote(Client):
    """A policy over the network."""

    refusal = Occupied

    def __init__(self, address: Address) -> None:
        self._url = address.url(address.text.partition(":")[0])
        super().__init__(f"{self._url}: ")

    def label(self) -> str:
        """What the server calls its policy. Raises PolicyError if it cannot be reached."""
        socket, offer = self._open()
        socket.close()
        return text(offer, "policy")

    def _connect(self) -> Channel:
        secret = token()
        return Socket(self._url, {"Authorization": f"Bearer {secret}"} if secret else None)

    def _open_again(self) -> tuple[Channel, dict[object, object]]:
        """As `_open`, of a server that may still be at work on the answer that this client gave up waiting for."""
        until = time.monotonic() + ANSWER_SECONDS
        while True:
            try:
                return retry_connect(self._open)
            except Occupied as error:
                if time.monotonic() > until:
                    raise NoAnswer(str(error)) from error
                time.sleep(0.2)


class RemoteForm:
    """The form ws://HOST:PORT of a policy's name. The server is asked at once what it serves: that is the label in results."""

    def name(self, text: str) -> PolicyName:
        """Connect and ask. Raises PolicyError."""
        return PolicyName(text, f"ws:{Remote(parse_address(text)).label()}")

    def make(self, text: str) -> Policy:
        """The client."""
        return Remote(parse_address(text))
