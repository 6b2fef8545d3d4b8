"""The server's side of this project's own protocol, without the network: messages in, messages out.

server                                              client
offer     protocol, version, policy, contract, setup
                                                    hello   version, embodiment, action_names, rate, image_sizes, chunk,
                                                            normalization, setup
welcome
                                                    reset   instruction, seed
ready
                                                    act     time, joints (A,), images {camera: (H,W,3) uint8},
                                                            committed (N,A) where there are some
actions   actions (A,) or (H,A)
error     reason, fault (how the episode ends where the policy failed: invalid_action, no_answer), then the connection is closed
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.data.setup import INTERFACE, RecipeError, Setup
from pipeline.evaluate.policies.contract import Contract, Served, declared, difference, mismatch, plain
from pipeline.evaluate.policies.policy import Observation, Policy, PolicyError, Start, chunk_of, count_inferences
from pipeline.evaluate.serving.wire import WireError, pack

PROTOCOL, VERSION = "domino-policy", 1
LONGEST_TEXT = 2000
MOST_NAMES = 256


class Session(Protocol):
    """One connection to a policy."""

    def greeting(self) -> dict[str, Any]:
        """What the server sends first."""
        ...

    def answer(self, message: dict[Any, Any]) -> dict[str, Any]:
        """The answer to a message. Raises WireError for one that cannot be answered, PolicyError if the policy refuses."""
        ...


class Language(Protocol):
    """A protocol that a server can speak."""

    def session(self, policy: Policy) -> Session:
        """A policy behind this protocol."""
        ...

    def error(self, reason: str, fault: str) -> bytes | str:
        """How the reason for ending a connection is sent; `fault` is one of FAULTS where the policy failed, else ""."""
        ...


@dataclass(frozen=True)
class Domino:
    """This project's protocol; `label` names the policy in results."""

    label: str

    def session(self, policy: Policy) -> Session:
        """A policy behind this protocol."""
        return DominoSession(policy, self.label)

    def error(self, reason: str, fault: str) -> bytes:
        """An error message."""
        return pack({"type": "error", "reason": reason, "fault": fault})


class DominoSession:
    """A policy behind this project's protocol, for one client."""

    def __init__(self, policy: Policy, label: str) -> None:
        self._policy, self._label = policy, label
        found = getattr(policy, "contract", None)
        self._contract = found if isinstance(found, Contract) else Contract()
        self._hello: tuple[str, Served, Setup] | None = None
        self._start: Start | None = None

    def greeting(self) -> dict[str, Any]:
        """The offer."""
        contract = {key: value for key, value in asdict(self._contract).items() if value is not None}
        offer = {"type": "offer", "protocol": PROTOCOL, "version": VERSION, "policy": self._label, "contract": contract}
        return offer | {"setup": plain(declared(self._policy))}

    def answer(self, message: dict[Any, Any]) -> dict[str, Any]:
        """See the protocol above."""
        match message.get("type"):
            case "hello":
                self._greet(message)
                return {"type": "welcome"}
            case "reset":
                self._reset(message)
                return {"type": "ready"}
            case "act":
                actions, inferences = self._act(message), count_inferences(self._policy)
                counted = {} if inferences is None else {"inferences": inferences}
                return {"type": "actions", "actions": actions, **counted}
            case other:
                raise WireError(f"message type {str(other)[:40]!r} is unknown: send hello, reset or act")

    def _greet(self, message: Mapping[Any, Any]) -> None:
        if message.get("version") != VERSION:
            raise PolicyError(f"protocol version: the server speaks {VERSION}, the client {str(message.get('version'))[:20]}")
        given = Served(
            action_names=names(message, "action_names"),
            rate=count(message, "rate"),
            image_sizes=sizes(message.get("image_sizes")),
            chunk=count(message, "chunk"),
            normalization=text(message, "normalization"),
        )
        setup = setup_of(message.get("setup", {"fps": given.rate}))
        if reason := mismatch(self._contract, given) or difference(declared(self._policy), setup):
            raise PolicyError(reason)
        self._hello, self._start = (text(message, "embodiment"), given, setup), None

    def _reset(self, message: Mapping[Any, Any]) -> None:
        if self._hello is None:
            raise WireError("reset before hello")
        embodiment, given, setup = self._hello
        self._start = Start(
            instruction=text(message, "instruction"),
            embodiment=embodiment,
            action_names=given.action_names,
            fps=given.rate,
            cameras=tuple(given.image_sizes),
            seed=count(message, "seed"),
            image_sizes=given.image_sizes,
            setup=setup,
        )
        self._policy.reset(self._start)

    def _act(self, message: Mapping[Any, Any]) -> NDArray[np.float64]:
        if self._start is None:
            raise WireError("act before reset")
        time, start = message.get("time"), self._start
        if not isinstance(time, int | float) or not 0 <= time < 1e6:
            raise WireError("time is no number of seconds")
        joints = array(message.get("joints"), "joints", (len(start.action_names),), "f")
        found = message.get("images")
        if not isinstance(found, dict) or found.keys() != start.image_sizes.keys():
            raise WireError(f"images are not those of hello: {', '.join(start.image_sizes) or 'none'}")
        images = {name: array(found[name], f"image {name}", (*size, 3), "u") for name, size in start.image_sizes.items()}
        depth, bodies = (self._maps(message.get(n, {}), n, kind) for n, kind in (("depth", "d"), ("segmentation", "u")))
        cloud = message.get("pointcloud")
        if cloud is not None:
            cloud = array(cloud, "pointcloud", (len(cloud) if isinstance(cloud, np.ndarray) else 0, 6), "f")
        committed = message.get("committed", np.empty((0, len(joints))))
        committed = array(committed, "committed", (len(committed) if isinstance(committed, np.ndarray) else 0, len(joints)), "f")
        seen = (images, depth, bodies, cloud, committed.astype(np.float64))
        observation = Observation(joints.astype(np.float64), start.instruction, float(time), *seen)
        return chunk_of(self._policy.act(observation), len(start.action_names))

    def _maps(self, found: object, what: str, kind: str) -> dict[str, NDArray[Any]]:
        """An array (H,W) for each camera, or none at all."""
        sizes = self._start.image_sizes if self._start else {}
        if not isinstance(found, dict) or (found and found.keys() != sizes.keys()):
            raise WireError(f"{what} is not that of the cameras of hello: {', '.join(sizes) or 'none'}")
        return {name: array(found[name], f"{what} {name}", tuple(size), kind) for name, size in sizes.items() if found}


def text(message: Mapping[Any, Any], key: str) -> str:
    """A text of a message. Raises WireError for anything else."""
    value = message.get(key)
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise WireError(f"{key} is no text of at most {LONGEST_TEXT} characters")
    return value


def count(message: Mapping[Any, Any], key: str) -> int:
    """A whole number from 0 of a message. Raises WireError for anything else."""
    value = message.get(key)
    if type(value) is not int or value < 0:
        raise WireError(f"{key} is no whole number from 0")
    return value


def names(message: Mapping[Any, Any], key: str) -> tuple[str, ...]:
    """A list of texts of a message. Raises WireError for anything else."""
    value = message.get(key)
    if (
        not isinstance(value, list)
        or not 0 < len(value) <= MOST_NAMES
        or not all(isinstance(v, str) and len(v) < 200 for v in value)
    ):
        raise WireError(f"{key} is no list of at most {MOST_NAMES} names")
    return tuple(value)


def sizes(value: object) -> dict[str, tuple[int, int]]:
    """(height, width) by camera. Raises WireError for anything else."""
    if not isinstance(value, dict) or len(value) > 16:
        raise WireError("image_sizes is no map of at most 16 cameras")
    out: dict[str, tuple[int, int]] = {}
    for name, size in value.items():
        good = isinstance(size, list) and len(size) == 2 and all(type(n) is int and 0 < n <= 4096 for n in size)
        if not isinstance(name, str) or len(name) > 100 or not good:
            raise WireError("image_sizes is no map from cameras to [height, width]")
        out[name] = (size[0], size[1])
    return out


def setup_of(value: object) -> Setup:
    """The setup of an evaluation. Raises WireError for anything else."""
    if not isinstance(value, dict):
        raise WireError("setup is no map")
    try:
        return Setup.parse(value)
    except RecipeError as error:
        raise WireError(str(error)) from error


def setup_keys(value: object) -> dict[str, Any]:
    """The keys of a setup that a policy is made for. Raises WireError for anything else."""
    setup = setup_of(value)
    return {key: getattr(setup, key) for key in INTERFACE if isinstance(value, dict) and key in value}


KINDS = {"f": ("f", 8, "floats"), "u": ("u", 1, "uint8"), "d": ("u", 2, "uint16")}
"""Kinds of arrays in messages: NumPy's kind, most bytes of an item, and what it is called."""


def array(value: object, what: str, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    """An array of this shape, of a kind of KINDS, finite. Raises WireError for anything else."""
    wanted, most, called = KINDS[kind]
    if (
        not isinstance(value, np.ndarray)
        or value.shape != shape
        or value.dtype.kind != wanted
        or value.itemsize > most
        or (kind == "d" and value.itemsize != most)
    ):
        found = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise WireError(f"{what} is {found}, not an array of {called} {shape}")
    if kind == "f" and not np.isfinite(value).all():
        raise WireError(f"{what} is not finite")
    return value


def contract_of(value: object) -> Contract:
    """The contract in an offer. Raises WireError for anything else."""
    if not isinstance(value, dict):
        raise WireError("the contract is no map")
    return Contract(
        action_names=names(value, "action_names") if "action_names" in value else None,
        image_sizes=sizes(value["image_sizes"]) if "image_sizes" in value else None,
        rate=count(value, "rate") if "rate" in value else None,
        chunk=count(value, "chunk") if "chunk" in value else None,
        normalization=text(value, "normalization"),
    )
