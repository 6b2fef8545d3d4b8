"""A policy behind messages."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.errors import DominoError
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.contract import Contract, action_length
from pipeline.evaluate.policies.files import ACTION_OPTIONS, stated_actions
from pipeline.evaluate.policies.fit import first_rows, pad_to_square
from pipeline.evaluate.policies.policy import (
    NoAnswer,
    Observation,
    PolicyError,
    PolicyName,
    Start,
    chunk_of,
)

from .address import Address, parse_address, token
from .messages import MessageError, pack, unpack
from .process import Process
from .session import VERSION, EpisodeMessage, Offer
from .websocket import ConnectionLost, Unreachable, WebSocket

ANSWER_SECONDS = 300.0  # what one answer may take by default: the first one often compiles a model

REOPEN_SECONDS = 30.0  # A server that answered before may be away, or busy, for so long

SIZE = 224  # pixels of the square images of openpi's servers

SCHEMES = ("ws", "wss", "openpi")


def open_again[T](opening: Callable[[], T]) -> T:
    """Tries for REOPEN_SECONDS. Raises NoAnswer."""
    until = time.monotonic() + REOPEN_SECONDS
    while True:
        try:
            return opening()
        except Unreachable as error:
            if time.monotonic() > until:
                raise NoAnswer(str(error)) from error
            time.sleep(0.2)


class Client:
    """A policy behind a connection, which is opened again if lost between episodes. A server
    without an offer is openpi's: square images of `size` pixels, the first `execute` rows of a
    chunk. Raises PolicyError."""

    def __init__(
        self,
        opening: Callable[[], WebSocket | Process],
        prefix: str = "",
        execute: int | None = None,
        size: int = SIZE,
    ) -> None:
        self._opening, self._prefix, self._execute, self._size = opening, prefix, execute, size
        self.seconds, self.inferences = ANSWER_SECONDS, None
        self.metadata, self._offer = dict[Any, Any](), cast(Offer | None, None)
        self.contract, self.setup = cast(Any, None), cast(Any, None)
        self._link: WebSocket | Process | None = None
        self._start: Start | None = None
        self._accepted, self._asked = False, 0
        self._open()

    @property
    def label(self) -> str | None:
        name = self.metadata.get("policy")
        return line_of_text(name) if self._offer is not None and isinstance(name, str) else None

    def reset(self, start: Start) -> None:
        """Begin an episode. Raises NoAnswer, and PolicyError for the first one."""
        self._start = start
        try:
            self._begin(start)
        except PolicyError as error:
            if isinstance(error, NoAnswer) or not self._accepted:
                raise
            raise NoAnswer(str(error)) from error
        self._accepted = True

    def act(self, observation: Observation) -> ArrayLike:
        """A chunk (H,A). Raises ActionError or NoAnswer."""
        if self._start is None:
            raise PolicyError(f"{self._prefix}asked before reset")
        plain = self._offer is None
        told = plain_message(observation, self._size) if plain else full_message(observation)
        answer = self._ask(told)
        actions, self.inferences = answer.get("actions"), answer.get("inferences")
        if not isinstance(actions, np.ndarray):
            held = line_of_text(", ".join(map(str, answer)))[:200] or "nothing"
            raise ActionError(f"{self._prefix}the answer has no array actions, but {held}")
        length = action_length(self, self._start.action_names)
        return chunk_of(first_rows(actions, self._execute), length)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = None

    def _begin(self, start: Start) -> None:
        if self._offer is None:
            self.close()  # an episode of openpi's servers is a connection
        try:
            if self._link is not None:
                return self._send_reset(start)
        except ConnectionLost:
            self.close()
        open_again(self._open)
        self._send_reset(start)

    def _send_reset(self, start: Start) -> None:
        if self._offer is not None:
            self._ask({"reset": EpisodeMessage.of(start).model_dump(exclude_defaults=True)})

    def _ask(self, message: Mapping[str, Any]) -> dict[Any, Any]:
        if self._link is None:
            raise ConnectionLost(f"{self._prefix}the connection is closed")
        self._asked += 1
        # a server with an offer repeats the number of the question in its answer
        number = {} if self._offer is None else {"id": self._asked}
        try:
            answer = unpack(self._link.ask(pack({**message, **number}), self.seconds))
        except MessageError as error:
            self.close()
            raise ActionError(f"{self._prefix}{error}") from error
        if number and (type(answer.get("id")) is not int or answer["id"] != self._asked):
            self.close()  # what arrives answers other questions
            raise ConnectionLost(f"{self._prefix}answered another question")
        return answer

    def _open(self) -> None:
        link = self._opening()
        try:
            self.metadata = unpack(link.greet())
            self._offer = self._read_offer(self.metadata.get("domino"))
        except MessageError as error:
            link.close()
            raise PolicyError(f"{self._prefix}{error}") from error
        except DominoError:
            link.close()
            raise
        self._link = link

    def _read_offer(self, value: object) -> Offer | None:
        if value is None:
            return None
        version = value.get("version") if isinstance(value, dict) else None
        if type(version) is not int or version != VERSION:
            theirs = f"the server speaks {line_of_text(version)[:20]}, this client {VERSION}"
            raise PolicyError(f"{self._prefix}protocol version: {theirs}")
        offer = Offer.read(value)
        self.contract, self.setup = offer.contract, offer.keys()
        return offer


def full_message(observation: Observation) -> dict[str, Any]:
    committed = observation.committed
    more = {
        "depth": dict(observation.depth),
        "segmentation": dict(observation.segmentation),
        "pointcloud": observation.pointcloud,
        "committed": None if committed is None else np.asarray(committed, np.float64),
    }
    return {
        "state": np.asarray(observation.joints, np.float64),
        "images": dict(observation.images),
        "prompt": observation.instruction,
        "time": observation.time,
        **{name: part for name, part in more.items() if part is not None and len(part)},
    }


def plain_message(observation: Observation, size: int) -> dict[str, Any]:
    """The message that openpi's policies for ALOHA take: images (3,S,S) by exported names."""
    images = {
        EXPORTED_CAMERAS[name]: np.ascontiguousarray(pad_to_square(image, size).transpose(2, 0, 1))
        for name, image in observation.images.items()
    }
    state = np.asarray(observation.joints, np.float32)
    return {"state": state, "images": images, "prompt": observation.instruction}


class Bridge(ABC):
    """A server of another protocol. `execute` rows of a chunk are executed."""

    def __init__(self, address: Address) -> None:
        self.address, self.execute = address, address.number("execute")
        self.seconds = ANSWER_SECONDS
        self.contract = Contract.of(stated_actions(address.options))

    @abstractmethod
    def greet(self) -> None:
        """Ask the server for a sign of life. Raises PolicyError."""

    @abstractmethod
    def reset(self, start: Start) -> None: ...

    @abstractmethod
    def act(self, observation: Observation) -> ArrayLike:
        """A chunk (H,A). Raises ActionError for none, else PolicyError."""

    @abstractmethod
    def close(self) -> None: ...


@dataclass(frozen=True)
class BridgeForm:
    """KIND://HOST:PORT?option=value"""

    client: Callable[[Address], Bridge]
    port: int
    options: tuple[str, ...]

    def name(self, text: str) -> PolicyName:
        client = self.make(text)
        client.greet()
        client.close()
        return PolicyName(text, client.address.label(), process="server")

    def make(self, text: str) -> Bridge:
        options = (*self.options, "label", *ACTION_OPTIONS)
        return self.client(parse_address(text, self.port, options))


class ServerForm:
    def name(self, text: str) -> PolicyName:
        client = self.make(text)
        client.close()
        return PolicyName(text, _server_address(text).label(client.label), process="server")

    def make(self, text: str) -> Client:
        address = _server_address(text)
        url = address.url("wss" if address.scheme == "wss" else "ws")
        secret = token()
        # openpi's servers call it an API key, and ours take both
        headers = {"Authorization": f"Api-Key {secret}"} if secret else {}
        execute, size = address.number("execute"), address.number("size") or SIZE
        client = Client(partial(WebSocket, url, headers), f"{url}: ", execute, size)
        if client.contract is None:
            client.contract = Contract.of(stated_actions(address.options))
        return client


def _server_address(text: str) -> Address:
    port = 8000 if text.startswith("openpi:") else None
    return parse_address(text, port, ("execute", "size", "label", *ACTION_OPTIONS))
