"""A policy on a StarVLA server (deployment/model_server of starVLA, revision 0ed0aad;
docs/policy_server.md).

    server    {"action_keys": [text, ...], "available_unnorm_keys", "training_obs_image_size"}
    client    {"type": "predict_action", "request_id": text, "payload": {"unnorm_key": text,
               "examples": [{"image": [(H,W,3) uint8, ...], "lang": text}]}}
    server    {"status", "ok": true, "request_id", "data": {"actions": (1,T,A)}}"""

from dataclasses import dataclass, replace
from functools import partial
from math import gcd
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.actions import JOINTS, Representation
from pipeline.data.parsing import MOST_PIXELS, ParseError, read_json, whole
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.fit import first_rows, scaled
from pipeline.evaluate.policies.policy import NoAnswer, Observation, PolicyError, Start
from pipeline.poses import Bools, Floats, Ints

from .address import Address
from .client import Bridge, open_again
from .history import History, HistorySettings
from .messages import MessageError, pack, unpack
from .websocket import WebSocket

PORT, SIZE = 10093, 224
OPTIONS = (
    *("unnorm_key", "execute", "size", "action_keys", "state"),
    *("statistics", "normalization", "grippers"),
    *("history", "history_mode", "history_size", "flow_size"),
)
SAMPLING = {"do_sample": False, "use_ddim": True, "num_ddim_steps": 10}  # as StarVLA's own clients

BOUNDS = {"min_max": ("min", "max"), "q99": ("q01", "q99")}
"""What -1 and 1 stand for, by normalization."""


class StarvlaClient(Bridge):
    def __init__(self, address: Address) -> None:
        super().__init__(address)
        self._url, self._options = address.url("ws"), address.options
        self._key, self._size = address.options.get("unnorm_key"), address.number("size")
        self._link: WebSocket | None = None
        self.inferences, self.metadata = 0, dict[Any, Any]()
        self._settings, self._past = _history_of(address), None
        self._ready, self._piece = np.empty((0, 0)), 1
        self._statistics: Statistics | None = None
        if (path := address.options.get("statistics")) is not None:
            kind = address.choice("normalization", tuple(BOUNDS))
            self._statistics = read_statistics(Path(path), self._key, kind)
            self._scaled_grippers = address.choice("grippers", ("raw", "scaled")) == "scaled"
        self._order = self._state_order = np.empty(0, int)

    def greet(self) -> None:
        self.close()
        opening = partial(WebSocket, self._url)
        self._link = open_again(opening) if self.metadata else opening()
        self.metadata = self._read(self._link.greet())

    def reset(self, start: Start) -> None:
        """An episode is a connection. Raises PolicyError for other keys."""
        self.greet()
        match self.metadata.get("training_obs_image_size"):
            case [height, width] if self._size is None and all(
                type(side) is int and 0 < side <= MOST_PIXELS for side in (height, width)
            ):
                self._shape = (height, width)
            case _:
                self._shape = (self._size or SIZE, self._size or SIZE)
        self._ready = np.empty((0, 0))
        self._past = None if self._settings is None else History(self._settings, start.fps)
        keys = self.metadata.get("available_unnorm_keys")
        if self._key and isinstance(keys, list) and self._key not in map(str, keys):
            has = line_of_text(keys)
            raise PolicyError(f"unnorm_key {self._key!r} is unknown to the server: it has {has}")
        actions, given = self.contract.actions, self._options.get("action_keys")
        order = given.split(",") if given else self.metadata.get("action_keys")
        self._order = _indices("action", order, start, actions)
        if self._options.get("state") == "true":
            state_keys = self.metadata.get("state_keys", order)
            self._state_order = _indices("state", state_keys, start, JOINTS)
        if (statistics := self._statistics) is not None:
            if (count := len(statistics.low)) != (robot := len(self._order)):
                raise PolicyError(f"the statistics have {count} numbers, the robot {robot}")
            names = actions.names(start.action_names)
            joint = np.array([not names[i].endswith("gripper") for i in self._order])
            normalized = statistics.normalized & (joint | self._scaled_grippers)
            self._statistics = replace(statistics, normalized=normalized)

    def act(self, observation: Observation) -> ArrayLike:
        """A chunk (T,A), or the part of it between two kept images."""
        if self._past is None or self._settings is None:
            return self._infer(observation)
        if not observation.images:
            raise PolicyError("history is made of images: name --cameras")
        self._past.add(observation.time, next(iter(observation.images.values())))
        if not len(self._ready):
            self._ready = self._infer(observation)
            self._piece = gcd(self._settings.stride, len(self._ready))
        answer, self._ready = self._ready[: self._piece], self._ready[self._piece :]
        return answer

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = None

    def _infer(self, observation: Observation) -> NDArray[Any]:
        if self._link is None:
            raise PolicyError(f"{self._url}: asked before reset")
        self.inferences += 1
        request = f"domino-{self.inferences}"
        images = [scaled(image, self._shape) for image in observation.images.values()]
        example: dict[str, Any] = {"image": images, "lang": observation.instruction}
        if self._past is not None:
            example["history_images"] = self._past.images()
        if self._options.get("state") == "true":
            example["state"] = np.asarray(observation.joints, np.float32)[self._state_order][None]
        key = {"unnorm_key": self._key} if self._key else {}
        payload = {"examples": [example], **SAMPLING, **key}
        message = {"type": "predict_action", "request_id": request, "payload": payload}
        answer = self._read(self._link.ask(pack(message), self.seconds))
        if (theirs := line_of_text(answer.get("request_id"))[:40]) != request:
            raise NoAnswer(f"{self._url}: answered request {theirs} instead of {request}")
        if answer.get("ok") is not True:
            reason = line_of_text(answer.get("error", answer.get("status")))
            raise NoAnswer(f"{self._url}: the server failed: {reason}")
        rows = self._actions(answer.get("data"))
        if self._statistics is not None:
            rows = self._statistics.joints(rows)
        ours = np.empty_like(rows)
        ours[:, self._order] = rows
        return first_rows(ours, self.execute)

    def _read(self, data: bytes) -> dict[Any, Any]:
        try:
            return unpack(data)
        except MessageError as error:
            self.close()
            raise ActionError(f"{self._url}: {error}") from error

    def _actions(self, data: object) -> NDArray[Any]:
        keys = ("actions", "normalized_actions")
        ours, other = keys if self._statistics is None else keys[::-1]
        values = data if isinstance(data, dict) else {}
        if ours not in values and other in values:
            fix = "give" if self._statistics is None else "leave out"
            raise ActionError(f"answers with {other}: {fix} ?statistics=dataset_statistics.json")
        actions = values.get(ours)
        if not isinstance(actions, np.ndarray) or actions.ndim != 3 or len(actions) != 1:
            raise ActionError(f"{self._url}: data.actions is no array (1,T,A)")
        if (count := actions.shape[2]) != (robot := len(self._order)):
            raise ActionError(f"{self._url}: actions have {count} numbers, the robot {robot}")
        return actions[0]


def _indices(kind: str, keys: object, start: Start, of: Representation) -> Ints:
    if not isinstance(keys, list):
        what = f"the server does not tell the order of its {kind}s"
        raise PolicyError(f"{what}: give ?action_keys=left_joints,left_gripper,... in its order")
    parts, names = of.slices(start.state_names), [str(key).rpartition(".")[2] for key in keys]
    if sorted(names) != sorted(parts):
        theirs, ours = line_of_text(" ".join(names)), " ".join(parts)
        raise PolicyError(f"{kind} keys: the server has {theirs}, the robot {ours}")
    return np.concatenate([np.arange(parts[name].start, parts[name].stop) for name in names])


@dataclass(frozen=True, eq=False)
class Statistics:
    """Bounds (A,) in the server's order; which are normalised (A,)."""

    low: Floats
    high: Floats
    normalized: Bools

    def joints(self, actions: NDArray[Any]) -> Floats:
        """Joint targets (T,A) of actions (T,A) clipped to [-1, 1]."""
        values = np.clip(np.asarray(actions, float), -1, 1)
        targets = self.low + (values + 1) / 2 * (self.high - self.low)
        return np.where(self.normalized, targets, values)


def read_statistics(path: Path, key: str | None, kind: str) -> Statistics:
    try:
        table = read_json(path)
        chosen = key or (next(iter(table)) if len(table) == 1 else None)
        if chosen not in table:
            known = line_of_text(", ".join(table))
            raise PolicyError(f"{path}: has statistics of {known}: give one as ?unnorm_key=")
        action = table[chosen]["action"]
        low, high = (np.asarray(action[name], float) for name in BOUNDS[kind])
        normalized = np.asarray(action.get("mask", np.ones(low.shape, bool)), bool)
        if low.ndim != 1 or not low.shape == high.shape == normalized.shape:
            raise ValueError("bounds of different lengths")
        if not np.isfinite([low, high]).all():
            raise ValueError("bounds that are not finite")
    except (ParseError, TypeError, KeyError, ValueError, AttributeError) as error:
        reason = line_of_text(error)
        raise PolicyError(f"{path}: is no dataset_statistics.json of StarVLA: {reason}") from error
    return Statistics(low, high, normalized)


def _history_of(address: Address) -> HistorySettings | None:
    text = address.options.get("history")
    if text is None:
        return None
    try:
        length, stride = (whole(part, 1, 100) for part in text.split(":"))
    except ValueError as error:
        raise PolicyError(f"history={text}: give LENGTH:STRIDE, from 1 to 100 each") from error
    flow = address.choice("history_mode", ("flow", "frames")) == "flow"
    kept, sent = address.number("flow_size") or 128, address.number("history_size") or SIZE
    return HistorySettings(length, stride, flow, kept, sent)
