"""Asks a policy: an outcome is a valid answer, or a fault that ends its episode (ActionError,
NoAnswer). What keeps it from being tried at all stays a PolicyError."""

import hashlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.actions import JOINTS
from pipeline.poses import Floats, Pixels

from .actions import ActionError, Answers
from .names import is_built_in, make_policy
from .policies import contract as contracts
from .policies.policy import (
    NoAnswer,
    Observation,
    Policy,
    PolicyError,
    PolicyName,
    SeesTruth,
    Start,
    attribute,
    chunk_of,
    count_inferences,
    foreign,
)
from .scenes.case import Case
from .scenes.trial import Trial
from .serving.client import ANSWER_SECONDS
from .serving.messages import pack

PROMPT = "hold still"  # the instruction of the question by which policies are told apart

FAULTS = (ActionError, NoAnswer)

ANSWERS = 10  # all answers of an episode may take this many times as long as one


def load_once(name: PolicyName) -> Policy:
    return _load(name.text, name.process, name.prints)


@lru_cache(maxsize=1)
def _load(text: str, process: str, prints: Path | None) -> Policy:
    return make_policy(PolicyName(text, text, process=process, prints=prints))


def introduce(
    name: PolicyName, starts: Sequence[Start], seconds: float = ANSWER_SECONDS
) -> PolicyName:
    policy = load_once(name)
    try:
        for start in starts:
            contracts.check_contract(policy, start)
        contracts.check_actions(policy, name.actions)
        if is_built_in(name) or isinstance(policy, SeesTruth):
            return name
        _limit(name, policy, seconds)
        return probe_policy(name, policy, starts[0])
    except PolicyError as error:
        raise PolicyError(f"policy {name.label}: {error}") from error


def probe_policy(name: PolicyName, policy: Policy, start: Start) -> PolicyName:
    """The name with its probe, a hash of two answers to a fixed question and of metadata. Raises
    PolicyError, also for an address whose answers differ."""
    anonymous = "://" in name.label
    try:
        first, second = _answer_of(policy, start), _answer_of(policy, start)
    except (ActionError, NoAnswer) as error:
        if not anonymous:
            return name
        raise PolicyError(f"{name.text}: gives no answer ({error}): add ?label=NAME") from error
    if first[1] != second[1] and anonymous:
        raise PolicyError(f"{name.text}: its answers differ: name it with ?label=NAME")
    same = b"|".join(a for a, b in zip(first, second, strict=True) if a == b)
    probe = hashlib.sha256(same).hexdigest()[:8]
    mark = "." if "@" in name.label else "@"
    label = name.label if "label=" in name.text else f"{name.label}{mark}{probe}"
    return replace(name, label=label, probe=probe)


def _answer_of(policy: Policy, start: Start) -> tuple[bytes, bytes]:
    contracts.begin(policy, start)
    images = dict[str, Pixels]()
    for camera, (height, width) in start.image_sizes.items():  # no encoder confuses it with another
        rows, columns = np.mgrid[:height, :width]
        bands = [rows * 255 // height, columns * 255 // width, (rows * columns) % 256]
        images[camera] = np.stack(bands, axis=-1).astype(np.uint8)
    joints = np.zeros(len(start.state_names))
    answer = policy.act(Observation(joints, start.instruction, 0.0, images))
    chunk = chunk_of(answer, contracts.action_length(policy, start.action_names))
    return pack(dict(attribute(policy, "metadata") or {})), chunk.tobytes()


class AskedPolicy:
    """An answer may take `seconds`, all together ANSWERS times that. Raises PolicyError."""

    def __init__(self, name: PolicyName, seconds: float = ANSWER_SECONDS) -> None:
        self._name, self._seconds, self._left = name, seconds, ANSWERS * seconds
        self.policy, self.count, self.inferences = load_once(name), 0, 0
        self._trial: Trial | None = None
        self._answers: Answers | None = None

    @property
    def unreachable(self) -> int | None:
        return None if self._answers is None else self._answers.unreachable

    @property
    def sees_truth(self) -> bool:
        return isinstance(self.policy, SeesTruth)

    def begin(self, start: Start, trial: Trial, case: Case) -> None:
        policy, self._trial = self.policy, trial
        contracts.check_contract(policy, start)
        if (representation := contracts.actions_of(policy)) != JOINTS:
            self._answers = Answers(representation, trial.simulation.embodiment)
        with self._in_time():
            with foreign("", NoAnswer, (PolicyError,)):
                contracts.begin(policy, start)
            if isinstance(policy, SeesTruth):
                with foreign("", NoAnswer, FAULTS):
                    policy.see(trial, case)

    def answer(self, observation: Observation, length: int) -> Floats:
        """A chunk (H,A) of joint targets. Raises ActionError or NoAnswer."""
        answers, trial = self._answers, self._trial
        with self._in_time(), foreign("", NoAnswer, FAULTS):
            before = count_inferences(self.policy)
            answer = self.policy.act(observation)
            chunk = chunk_of(answer, length if answers is None else answers.length)
            after = count_inferences(self.policy)
        if answers is not None and trial is not None:
            chunk = answers.joints(chunk, observation.joints, trial.simulation.command)
        self.inferences += self.count == 0 or after is None or after != before
        self.count += 1
        return chunk

    @contextmanager
    def _in_time(self) -> Iterator[None]:
        began = time.monotonic()
        _limit(self._name, self.policy, max(0.001, min(self._seconds, self._left)))
        try:
            yield
        finally:
            self._left -= time.monotonic() - began


def _limit(name: PolicyName, policy: Any, seconds: float) -> None:
    if name.process != "evaluator":
        policy.seconds = seconds
