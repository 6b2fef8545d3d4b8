"""Code that asks an environment for its next observation, turned into a policy that is asked for
its next action."""

import queue
import threading
from collections.abc import Callable
from typing import Any

from pipeline.evaluate.policies.policy import Observation, PolicyError

JOIN_SECONDS = 10.0


class Over(BaseException):
    """Ends the code in its thread; no `except Exception` of its own stops it."""


class Turns:
    """Runs `work(turns)` in a thread that waits in `after(action)` while the world advances: the
    two never run at the same time."""

    def __init__(self, work: Callable[["Turns"], None]) -> None:
        self._work = work
        self._observations: queue.SimpleQueue[Observation | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._ended = False

    def ask(self, observation: Observation) -> Any:
        """The next action. Raises what the work raises, and PolicyError if it has ended."""
        if self._ended:
            raise PolicyError("the policy's code has ended: it is asked again at the next episode")
        self._observations.put(observation)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()
        answer = self._answers.get()
        if isinstance(answer, BaseException):
            self._ended = True
            raise answer
        return answer

    def first(self) -> Observation:
        """In the thread: the first observation. Raises Over if there is none."""
        return self._next()

    def after(self, action: Any) -> Observation:
        """In the thread: hand over an action and wait for the observation that follows. Raises Over
        at the end of the episode."""
        self._answers.put(action)
        return self._next()

    def end(self) -> None:
        """End the work, wherever it waits."""
        if self._thread is not None and self._thread.is_alive():
            self._observations.put(None)
            self._thread.join(JOIN_SECONDS)

    def _next(self) -> Observation:
        observation = self._observations.get()
        if observation is None:
            raise Over
        return observation

    def _run(self) -> None:
        try:
            self._work(self)
            self._answers.put(PolicyError("the policy's code ended before the episode did"))
        except Over:
            return
        except BaseException as error:  # noqa: BLE001 (raised again by ask, in the thread of whoever asks)
            self._answers.put(error)
