"""One policy for many episodes: questions are answered in batches."""

import queue
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.policy import BatchPolicy, Observation, PolicyError, Start

MOST = 64  # questions of one batch


@dataclass(frozen=True, eq=False)
class Question:
    about: Any
    observation: Observation | None
    answer: Future[Any] = field(default_factory=Future[Any])


class Batcher:
    """Answers all seats with one policy in a thread: once every playing seat has asked, `most`
    questions are there, or the first has waited for `wait` s."""

    def __init__(self, policy: BatchPolicy, wait: float, most: int = MOST) -> None:
        self.policy, self._wait, self._most = policy, wait, most
        self._asked: queue.SimpleQueue[Question] = queue.SimpleQueue()
        self._lock, self._playing = threading.Lock(), set[Seat]()
        threading.Thread(target=self._work, daemon=True).start()

    def seat(self) -> "Seat":
        return Seat(self)

    def begin(self, seat: "Seat", start: Start) -> Any:
        episode = self.ask(start, None)
        with self._lock:
            self._playing.add(seat)
        return episode

    def leave(self, seat: "Seat") -> None:
        with self._lock:
            self._playing.discard(seat)

    def ask(self, about: Any, observation: Observation | None) -> Any:
        question = Question(about, observation)
        self._asked.put(question)
        return question.answer.result()

    def _work(self) -> None:
        while True:
            batch, until = list[Question](), 0.0
            with suppress(queue.Empty):
                while not batch or len(batch) < min(self._most, len(self._playing)):
                    left = max(0.0, until - time.monotonic()) if batch else None
                    question = self._asked.get(timeout=left)
                    if question.observation is None:
                        self._begin(question)
                        continue
                    until = until if batch else time.monotonic() + self._wait
                    batch.append(question)
            self._answer(batch)

    def _begin(self, question: Question) -> None:
        try:
            question.answer.set_result(self.policy.begin(question.about))
        except BaseException as error:  # noqa: BLE001 (raised again where the question was asked)
            question.answer.set_exception(error)

    def _answer(self, batch: list[Question]) -> None:
        try:
            asked = [(q.about, q.observation) for q in batch if q.observation is not None]
            answers = list(self.policy.act_together(asked))
            if len(answers) != len(batch):
                raise ActionError(f"{len(answers)} answers to {len(batch)} questions")
        except BaseException as error:  # noqa: BLE001 (raised again where the question was asked)
            if len(batch) == 1:
                return batch[0].answer.set_exception(error)
            for question in batch:
                self._answer([question])
            return
        for question, answer in zip(batch, answers, strict=True):
            question.answer.set_result(answer)


class Seat:
    def __init__(self, batcher: Batcher) -> None:
        self._batcher, self._episode = batcher, None

    def __getattr__(self, name: str) -> Any:
        if name in ("contract", "setup", "fps", "cameras", "size"):
            return getattr(self._batcher.policy, name)
        raise AttributeError(name)

    @property
    def inferences(self) -> int | None:
        return getattr(self._episode, "inferences", None)

    def reset(self, start: Start) -> None:
        self._episode = self._batcher.begin(self, start)

    def act(self, observation: Observation) -> ArrayLike:
        return self._batcher.ask(self._episode, observation)

    def leave(self) -> None:
        self._batcher.leave(self)


def batcher_of(policy: object, label: str, wait: float) -> Batcher:
    if not isinstance(policy, BatchPolicy):
        raise PolicyError(f"{label}: is no BatchPolicy: leave out --batch-wait")
    return Batcher(policy, wait)
