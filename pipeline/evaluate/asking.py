"""Asks a policy, within a time limit: whatever it does becomes a valid answer or one of two faults that end its episode.

ActionError: it answered with something that is no action. NoAnswer: it raised an error, lost its connection, tried to end the
program, or ran out of time. What keeps a policy from being tried at all (no server, another robot) stays a PolicyError.
"""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.data.errors import DominoError
from pipeline.data.time_limit import time_limit
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.names import make_policy
from pipeline.evaluate.policies.contract import check_contract
from pipeline.evaluate.policies.policy import (
    Gone,
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
)
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.trial import Trial

ANSWER_SECONDS = 300.0
"""What one answer may take by default: the first one often compiles a model."""

ANSWERS = 10
"""All answers of an episode together may take this many times as long as one."""


class Late(Gone):
    """The time limit passed. The policy was interrupted anywhere."""


@lru_cache(maxsize=1)
def load_once(name: PolicyName) -> Policy:
    """The policy of a name, made once in a process: loading one may take long. Raises PolicyError."""
    return make_policy(name)


def _late_after(seconds: float) -> AbstractContextManager[None]:
    return time_limit(seconds, Late(f"no answer in {seconds:.3g} s"))


class Asked:
    """A policy in one episode. One answer may take `seconds`, all together ANSWERS times that; `count` are the answers so far,
    `inferences` those that its network ran for: the first one, and all of them if the policy does not count.

    Raises PolicyError if the policy cannot be made.
    """

    def __init__(self, name: PolicyName, seconds: float = ANSWER_SECONDS) -> None:
        self._seconds, self._left = seconds, ANSWERS * seconds
        self.policy, self.count, self.inferences = load_once(name), 0, 0

    @property
    def sees_truth(self) -> bool:
        """Whether the policy is shown the simulation."""
        return isinstance(self.policy, SeesTruth)

    def begin(self, start: Start, trial: Trial, case: Case) -> None:
        """Begin the episode. Raises NoAnswer if the policy fails, PolicyError if it refuses the episode."""
        policy, refusal = self.policy, None
        check_contract(policy, start)
        with self._translate_errors():
            try:
                policy.reset(start)
            except NoAnswer:
                raise
            except PolicyError as error:
                refusal = error
        if refusal is not None:
            raise refusal
        if isinstance(policy, SeesTruth):
            with self._translate_errors():
                policy.see(trial, case)

    def answer(self, observation: Observation, length: int) -> NDArray[np.float64]:
        """The next chunk (H,A) of actions with `length` numbers. Raises ActionError or NoAnswer."""
        with self._translate_errors():
            before = count_inferences(self.policy)
            chunk = chunk_of(self.policy.act(observation), length)
            after = count_inferences(self.policy)
        self.inferences += self.count == 0 or after is None or after != before
        self.count += 1
        return chunk

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        began = time.monotonic()
        try:
            with _late_after(max(0.001, min(self._seconds, self._left))):
                yield
        except Gone:
            self._discard()
            raise
        except (ActionError, NoAnswer, KeyboardInterrupt):
            raise
        except DominoError as error:
            raise NoAnswer(str(error)) from error
        except BaseException as error:
            raise NoAnswer(line_of(error)) from error
        finally:
            self._left -= time.monotonic() - began

    def _discard(self) -> None:
        """Have the policy made again for the next episode, and end what it holds, such as a connection."""
        load_once.cache_clear()
        try:
            with _late_after(self._seconds):
                if callable(close := attribute(self.policy, "close")):
                    close()
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001 (it is given up already)
            return
