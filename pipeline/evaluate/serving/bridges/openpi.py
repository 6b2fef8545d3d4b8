"""openpi's protocol (ALOHA), as a client of its servers and as a server for its clients.

    server    metadata, a map
    client    {"state": (14,) float32, "images": {"cam_high", "cam_left_wrist", "cam_right_wrist": (3,S,S) uint8}, "prompt": text}
    server    {"actions": (H,14), "server_timing": {"infer_ms"}}; an error as text, then close code 1011

Joints are in our order, left arm, left gripper, right arm, right gripper, grippers 0-1. Our client opens a connection for each
episode. openpi's own keeps one and tells its server of no reset: an episode begins with a new prompt, or where the robot stands at
home although the last answer did not take it there; or after every N questions.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.contract import check_contract
from pipeline.evaluate.policies.fit import DATASET_CAMERAS, first_rows, pad_to_square
from pipeline.evaluate.policies.policy import Observation, Policy, PolicyError, Start, chunk_of, policy_seed
from pipeline.evaluate.serving.address import Address, token
from pipeline.evaluate.serving.session import Session, array, text
from pipeline.evaluate.serving.socket import CONNECT_SECONDS, Socket, retry_connect
from pipeline.evaluate.serving.wire import WireError
from pipeline.world.robots import get_embodiment

PORT, SIZE = 8000, 224
AT_HOME, LEFT_HOME = 0.03, 0.1
"""rad or m; a robot within AT_HOME of home whose last answer kept farther than LEFT_HOME from it was put there."""


class OpenpiClient:
    """A policy on an openpi server. `execute` rows of every chunk are executed, all by default; images are squares of `size`."""

    def __init__(self, address: Address) -> None:
        self._url = address.url("ws")
        self._execute, self._size = address.number("execute"), address.number("size", SIZE) or SIZE
        self._socket: Socket | None = None
        self.metadata: dict[Any, Any] = {}

    def reset(self, start: Start) -> None:
        """Open a connection. Raises PolicyError."""
        self.greet()

    def greet(self) -> None:
        """Open a connection and read the server's metadata. Raises PolicyError."""
        self.close()
        self._socket = retry_connect(self._open) if self.metadata else self._open()
        self.metadata = self._socket.receive(CONNECT_SECONDS)

    def _open(self) -> Socket:
        secret = token()
        return Socket(self._url, {"Authorization": f"Api-Key {secret}"} if secret else None)

    def act(self, observation: Observation) -> ArrayLike:
        """A chunk (H,A). Raises PolicyError."""
        if self._socket is None:
            raise PolicyError(f"{self._url}: asked before reset")
        images = {
            EXPORTED_CAMERAS[name]: np.ascontiguousarray(pad_to_square(image, self._size).transpose(2, 0, 1))
            for name, image in observation.images.items()
        }
        state = np.asarray(observation.joints, np.float32)
        answer = self._socket.ask({"state": state, "images": images, "prompt": observation.instruction})
        actions = answer.get("actions")
        if not isinstance(actions, np.ndarray):
            raise ActionError(f"{self._url}: the answer has no array actions, but {', '.join(map(str, answer)) or 'nothing'}")
        return first_rows(actions, self._execute)

    def close(self) -> None:
        """End the connection."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None


@dataclass(frozen=True)
class Openpi:
    """The language of a server that openpi's clients can talk to. They do not name their robot: `embodiment` is assumed.

    With `reset_every` an episode has that many questions; with 0 its end is recognised.
    """

    label: str
    embodiment: str
    reset_every: int = 0

    def session(self, policy: Policy) -> Session:
        """A policy behind this protocol."""
        return OpenpiSession(policy, self)

    def error(self, reason: str, fault: str) -> str:
        """Errors are text."""
        return reason


class OpenpiSession:
    """A policy for one connection of an openpi client, which may hold many episodes."""

    def __init__(self, policy: Policy, language: Openpi) -> None:
        self._policy, self._language, self._robot = policy, language, get_embodiment(language.embodiment)
        arms = self._robot.arms.values()
        self._home = np.array([value for arm in arms for value in (*arm.home, np.nan)])  # wherever the grippers are
        self._start: Start | None = None
        self._asked = self._periods = 0
        self._last = np.empty((0, 0))

    def greeting(self) -> dict[str, Any]:
        """The metadata."""
        return {"policy": self._language.label, "embodiment": self._language.embodiment}

    def answer(self, message: dict[Any, Any]) -> dict[str, Any]:
        """Infer. The clock of the observation counts control periods of the chunks answered so far in the episode."""
        prompt, images = text(message, "prompt"), _images(message.get("images"))
        sizes = {name: (image.shape[0], image.shape[1]) for name, image in images.items()}
        length = len(self._robot.vector_names)
        state = array(message.get("state"), "state", (length,), "f").astype(np.float64)
        if self._start is not None and dict(self._start.image_sizes) != sizes:
            raise WireError("images are of other cameras or sizes than before")
        if self._start is None or self._is_new(prompt, state):
            seed = policy_seed(prompt, self._robot.name)
            start = Start(prompt, self._robot.name, self._robot.vector_names, DEFAULT_FPS, tuple(sizes), seed, sizes)
            check_contract(self._policy, start)
            self._policy.reset(start)
            self._start, self._asked, self._periods = start, 0, 0
        began = time.perf_counter()
        chunk = chunk_of(self._policy.act(Observation(state, prompt, self._periods / DEFAULT_FPS, images)), length)
        self._asked, self._periods, self._last = self._asked + 1, self._periods + len(chunk), chunk
        return {"actions": chunk, "server_timing": {"infer_ms": 1000 * (time.perf_counter() - began)}}

    def _is_new(self, prompt: str, state: NDArray[np.float64]) -> bool:
        """Whether another episode has begun since the last answer."""
        if self._language.reset_every:
            return self._asked >= self._language.reset_every
        if self._start is not None and prompt != self._start.instruction:
            return True
        return self._from_home(state[None]) < AT_HOME and self._from_home(self._last) > LEFT_HOME

    def _from_home(self, rows: NDArray[np.float64]) -> float:
        """How near (rad or m, the joint that is farthest) any of joint vectors (N,A) is to the robot's home."""
        return float(np.nanmax(np.abs(rows - self._home), axis=1).min())


def _images(found: object) -> dict[str, NDArray[np.uint8]]:
    """Images by the names of our cameras."""
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise WireError("images is no map from cameras to arrays")
    out: dict[str, NDArray[np.uint8]] = {}
    for name, value in found.items():
        out[DATASET_CAMERAS.get(str(name), str(name))] = _image(str(name), value)
    return out


def _image(name: str, value: object) -> NDArray[np.uint8]:
    """(3,H,W) or (H,W,3) uint8 as (H,W,3)."""
    if not isinstance(value, np.ndarray) or value.dtype != np.uint8 or value.ndim != 3 or 3 not in (value.shape[0], value.shape[2]):
        raise WireError(f"image {name[:40]} is no array (3,H,W) or (H,W,3) of uint8")
    return np.ascontiguousarray(value.transpose(1, 2, 0)) if value.shape[0] == 3 else value
