"""A policy on a GR00T server: ZeroMQ requests of msgpack maps, with the keys of
meta/modality.json.

"get_action" sends "video" {camera: (1,1,H,W,3) uint8}, "state" {part: (1,1,D) float32},
"language" {key: [[text]]}. The answer is [{part: (1,T,D)}, information], or {"error": text}; an
array is {"__ndarray_class__": true, "as_npy": NPY file}."""

import io
from tokenize import TokenError
from typing import Any

import msgpack
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.actions import JOINTS
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.fit import first_rows
from pipeline.evaluate.policies.policy import NoAnswer, Observation, PolicyError, Start

from .address import Address, token
from .client import Bridge
from .messages import LARGEST, MessageError, unpack

PORT = 5555
LANGUAGE = "annotation.human.action.task_description"
PING_SECONDS = 10.0


class GrootClient(Bridge):
    def __init__(self, address: Address) -> None:
        super().__init__(address)
        self._url = address.url("tcp")
        self._socket: Any = None
        self._parts = self._state_parts = dict[str, slice]()

    def reset(self, start: Start) -> None:
        self._parts = self.contract.actions.slices(start.action_names)
        self._state_parts = JOINTS.slices(start.state_names)
        self._ask("reset", {"options": None}, self.seconds)

    def act(self, observation: Observation) -> ArrayLike:
        joints = np.asarray(observation.joints, np.float32)
        images = observation.images
        seen = {
            "video": {EXPORTED_CAMERAS[name]: image[None, None] for name, image in images.items()},
            "state": {part: joints[None, None, at] for part, at in self._state_parts.items()},
            "language": {LANGUAGE: [[observation.instruction]]},
        }
        answer = self._ask("get_action", {"observation": seen, "options": None}, self.seconds)
        action = answer[0] if isinstance(answer, list) and answer else answer
        if not isinstance(action, dict):
            raise ActionError(f"the answer is a {type(action).__name__}, not a map of actions")
        rows: list[NDArray[Any]] = []
        for part in self._parts:
            row = action.get(part, action.get(f"action.{part}"))
            if not isinstance(row, np.ndarray):
                held = line_of_text(", ".join(map(str, action)))[:200] or "nothing"
                raise ActionError(f"{self._url}: the answer has no {part}, but {held}")
            rows.append(row)
        count = rows[0].shape[1] if rows[0].ndim == 3 else 0
        shapes = [row.shape for row in rows]
        if shapes != [(1, count, at.stop - at.start) for at in self._parts.values()]:
            held = ", ".join(map(str, shapes))
            raise ActionError(f"{self._url}: actions have the shapes {held}, not (1,T,D)")
        return first_rows(np.concatenate([row[0] for row in rows], axis=1), self.execute)

    def greet(self) -> None:
        try:
            self._ask("ping", None, PING_SECONDS)
        except ModuleNotFoundError as error:
            raise PolicyError("gr00t: needs pyzmq: `uv sync --inexact --extra gr00t`") from error

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _ask(self, endpoint: str, data: dict[str, Any] | None, seconds: float) -> Any:
        import zmq

        request: dict[str, Any] = {"endpoint": endpoint} | ({"data": data} if data else {})
        if secret := token():
            request["api_token"] = secret
        try:
            socket = self._open(seconds)
            socket.send(msgpack.packb(request, default=_encode))
            # an answer may be a list, a message of ours is a map: it becomes one
            answer = unpack(b"\x81\xa1a" + socket.recv(), decode=_decode)["a"]
        except zmq.ZMQError as error:
            self.close()
            late = f"no answer to {endpoint} in {seconds:.3g} s"
            reason = late if isinstance(error, zmq.Again) else error
            raise NoAnswer(f"{self._url}: {reason}") from error
        except MessageError as error:
            self.close()
            raise ActionError(f"{self._url}: {error}") from error
        if isinstance(answer, dict) and "error" in answer:
            raise NoAnswer(f"{self._url}: the server failed: {line_of_text(answer['error'])}")
        return answer

    def _open(self, seconds: float) -> Any:
        import zmq

        if self._socket is None:
            self._socket = zmq.Context.instance().socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.setsockopt(zmq.SNDTIMEO, round(1000 * PING_SECONDS))
            self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST)
            self._socket.connect(self._url)
        self._socket.setsockopt(zmq.RCVTIMEO, max(1, round(1000 * seconds)))
        return self._socket


def _encode(value: object) -> dict[str, Any]:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a {type(value).__name__} cannot be sent")
    file = io.BytesIO()
    np.save(file, value, allow_pickle=False)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def _decode(values: dict[Any, Any]) -> Any:
    if "__ndarray_class__" not in values:
        return values
    data = values.get("as_npy")
    return npy(data if isinstance(data, bytes) else b"")


def npy(data: bytes) -> NDArray[Any]:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, SyntaxError, TokenError, EOFError, OSError, MemoryError) as error:
        raise MessageError(f"an array is no NPY file: {line_of_text(error)[:200]}") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        raise MessageError("an array is no NPY file of booleans, integers or floats")
    return array
