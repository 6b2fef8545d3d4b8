"""The server's side of the protocol (docs/policy_server.md), without a network.

openpi's own clients send no reset: an episode begins with a new prompt, or if the robot is home
unasked."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.errors import DominoError
from pipeline.data.parsing import Strict, first_fault
from pipeline.data.setup import INTERFACE, RecipeError, Setup
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of, line_of_text
from pipeline.evaluate.policies import contract as contracts
from pipeline.evaluate.policies.fit import DATASET_CAMERAS
from pipeline.evaluate.policies.policy import (
    NoAnswer,
    Observation,
    Policy,
    Start,
    attribute,
    chunk_of,
    count_inferences,
    policy_seed,
)
from pipeline.poses import Floats, Pixels
from pipeline.world.robots import get_embodiment

from .messages import FAILED, INVALID, REFUSED, MessageError, pack, unpack

VERSION = 2
AT_HOME, LEFT_HOME = 0.03, 0.1
"""rad or m; a robot this near to home whose last answer kept LEFT_HOME away was put there."""


class _Message(Strict):
    @classmethod
    def read(cls, value: object) -> Self:
        try:
            return cls.model_validate(value)
        except ValidationError as error:
            line = f"{cls.__name__.lower()}: {first_fault(error)}"
            raise MessageError(line_of_text(line)) from error


class Offer(_Message):
    version: int
    contract: contracts.Contract
    setup: dict[str, Any] = Field(default_factory=dict)

    def keys(self) -> dict[str, Any]:
        setup = _setup_of(self.setup)
        return {key: getattr(setup, key) for key in INTERFACE if key in self.setup}


class EpisodeMessage(_Message):
    prompt: str = Field(max_length=2000)
    embodiment: str = Field(max_length=200)
    action_names: tuple[str, ...] = Field(min_length=1, max_length=256)
    rate: int = Field(gt=0, le=1000)
    image_sizes: dict[str, tuple[int, int]] = Field(max_length=16)
    seed: int = Field(ge=0)
    setup: dict[str, Any] = Field(default_factory=dict)
    lift: float = Field(default=0.0, ge=-1, le=1)

    @classmethod
    def of(cls, start: Start) -> Self:
        return cls(
            prompt=start.instruction,
            embodiment=start.embodiment,
            action_names=start.state_names,
            rate=start.fps,
            image_sizes=dict(start.image_sizes),
            seed=start.seed,
            setup=start.setup.given(),
            lift=start.lift,
        )

    def start(self) -> Start:
        common = (self.prompt, self.embodiment, self.action_names, self.rate)
        sizes, setup = self.image_sizes, _setup_of(self.setup)
        return Start(*common, tuple(sizes), self.seed, sizes, setup, self.lift)


@dataclass(frozen=True)
class ServerOptions:
    """The policy's name, and the robot of clients without "reset"."""

    label: str
    embodiment: str = "aloha-agilex"


class Session:
    def __init__(self, policy: Policy, options: ServerOptions) -> None:
        self._policy, self._options = policy, options
        self._start: Start | None = None
        self._periods = 0
        self._last = np.empty((0, 0))

    def metadata(self) -> dict[str, Any]:
        made_for = attribute(self._policy, "contract")
        made_for = made_for if isinstance(made_for, contracts.Contract) else contracts.Contract()
        setup = contracts.plain(contracts.declared(self._policy))
        offer = {"version": VERSION, "contract": made_for.to_dict(), "setup": setup}
        return {"policy": self._options.label, "domino": offer}

    def answer(self, message: Mapping[Any, Any]) -> dict[str, Any]:
        echo = {"id": message["id"]} if isinstance(message.get("id"), int) else {}
        if "reset" in message:
            self._begin(EpisodeMessage.read(message["reset"]).start())
            return echo
        began = time.perf_counter()
        ours = "time" in message
        observation = self._observation(message) if ours else self._plain_observation(message)
        length = len(observation.joints)
        if self._start is not None:
            length = contracts.action_length(self._policy, self._start.action_names)
        self._last = actions = chunk_of(self._policy.act(observation), length)
        self._periods += len(actions)
        inferences = count_inferences(self._policy)
        counted = {} if inferences is None else {"inferences": inferences}
        timing = {"infer_ms": 1000 * (time.perf_counter() - began)}
        return {"actions": actions, "server_timing": timing, **counted, **echo}

    def _begin(self, start: Start) -> None:
        self._start, self._periods = None, 0
        contracts.check_contract(self._policy, start)
        contracts.begin(self._policy, start)
        self._start = start

    def _observation(self, message: Mapping[Any, Any]) -> Observation:
        start, seconds = self._start, message["time"]
        if start is None:
            raise MessageError("an observation before reset")
        if not isinstance(seconds, int | float) or not 0 <= seconds < 1e6:
            raise MessageError("time is no number of seconds")
        names = len(start.action_names)
        images = _arrays(message, "images", start, (3,), "u1")
        if images.keys() != start.image_sizes.keys():
            raise MessageError("images: those of reset are missing")
        depth = _arrays(message, "depth", start, (), "u2")
        bodies = _arrays(message, "segmentation", start, (), "u1")
        cloud = message.get("pointcloud")
        if cloud is not None:
            cloud = _array(cloud, "pointcloud", (_length(cloud), 6), "f")
        committed = message.get("committed", np.empty((0, names)))
        committed = _array(committed, "committed", (_length(committed), names), "f")
        state = _array(message.get("state"), "state", (names,), "f").astype(np.float64)
        seen = (images, depth, bodies, cloud, committed.astype(np.float64))
        prompt = message.get("prompt", start.instruction)
        if not isinstance(prompt, str) or len(prompt) > 2000:
            raise MessageError("prompt is no text of at most 2000 characters")
        return Observation(state, prompt, float(seconds), *seen)

    def _plain_observation(self, message: Mapping[Any, Any]) -> Observation:
        """openpi's own; `time` counts periods of chunks so far."""
        prompt, robot = message.get("prompt"), get_embodiment(self._options.embodiment)
        if not isinstance(prompt, str) or len(prompt) > 2000:
            raise MessageError("prompt is no text of at most 2000 characters")
        names, images = robot.vector_names, _plain_images(message.get("images"))
        state = _array(message.get("state"), "state", (len(names),), "f").astype(np.float64)
        sizes = {name: (image.shape[0], image.shape[1]) for name, image in images.items()}
        if self._start is not None and dict(self._start.image_sizes) != sizes:
            raise MessageError("images are of other cameras or sizes than before")
        if self._start is None or self._is_new(prompt, state, self._start):
            seed = policy_seed(prompt, robot.name)
            self._begin(Start(prompt, robot.name, names, DEFAULT_FPS, tuple(sizes), seed, sizes))
        return Observation(state, prompt, self._periods / DEFAULT_FPS, images)

    def _is_new(self, prompt: str, state: Floats, start: Start) -> bool:
        if prompt != start.instruction:
            return True
        return self._from_home(state[None]) < AT_HOME and self._from_home(self._last) > LEFT_HOME

    def _from_home(self, rows: Floats) -> float:
        """rad or m of the farthest arm joint, the nearest of (N,A)."""
        arms = get_embodiment(self._options.embodiment).arms.values()
        home = np.array([value for arm in arms for value in (*arm.home, np.nan)])
        return float(np.nanmax(np.abs(rows - home), axis=1).min())


def respond(session: Session, data: bytes | str) -> bytes | tuple[str, int]:
    return guarded(lambda: pack(session.answer(unpack(data))))


def guarded[T](work: Callable[[], T]) -> T | tuple[str, int]:
    try:
        return work()
    except ActionError as error:
        return str(error), INVALID
    except DominoError as error:
        return str(error), FAILED if isinstance(error, NoAnswer) else REFUSED
    except BaseException as error:  # noqa: BLE001 (a policy that raises ends its client, not the server)
        return line_of(error), FAILED


def _array(value: object, what: str, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    """ "f" (floats), "u1" or "u2". Raises MessageError."""
    if not isinstance(value, np.ndarray):
        raise MessageError(f"{what} is {type(value).__name__}, not an array")
    if value.shape != shape or kind not in (value.dtype.kind, value.dtype.str[1:]):
        called = {"f": "floats", "u1": "uint8", "u2": "uint16"}[kind]
        raise MessageError(f"{what} is {value.dtype} {value.shape}, not {called} {shape}")
    if kind == "f" and not np.isfinite(value).all():
        raise MessageError(f"{what} is not finite")
    return value


def _length(value: object) -> int:
    return len(value) if isinstance(value, np.ndarray) and value.ndim else 0


def _arrays(
    message: Mapping[Any, Any], key: str, start: Start, tail: tuple[int, ...], kind: str
) -> dict[str, NDArray[Any]]:
    """(H,W,*tail) by camera. Raises MessageError for unknown cameras."""
    arrays, sizes = message.get(key, {}), start.image_sizes
    if not isinstance(arrays, dict) or not arrays.keys() <= sizes.keys():
        raise MessageError(f"{key} are not those of reset: {', '.join(sizes) or 'none'}")
    return {c: _array(v, f"{key} {c}", (*sizes[c], *tail), kind) for c, v in arrays.items()}


def _setup_of(values: Mapping[str, Any]) -> Setup:
    try:
        return Setup.parse(values)
    except RecipeError as error:
        raise MessageError(line_of_text(error)) from error


def _plain_images(images: object) -> dict[str, Pixels]:
    """(H,W,3) by our cameras, from (3,H,W) or (H,W,3)."""
    if not isinstance(images, dict):
        raise MessageError("images is no map from cameras to arrays")
    out = dict[str, Pixels]()
    for name, image in ((str(name), image) for name, image in images.items()):
        rgb = isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim == 3
        if not rgb or 3 not in (image.shape[0], image.shape[2]):
            raise MessageError(f"image {name[:40]} is no array (3,H,W) or (H,W,3) of uint8")
        hwc = image.transpose(1, 2, 0) if image.shape[0] == 3 else image
        out[DATASET_CAMERAS.get(name, name)] = np.ascontiguousarray(hwc)
    return out
