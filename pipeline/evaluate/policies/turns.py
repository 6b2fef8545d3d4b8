"""Code that waits for its turn: it runs in a thread while the world stands still."""

import queue
import threading
from collections.abc import Callable

JOIN_SECONDS = 10.0


class Over(BaseException):
    """No `except Exception` of foreign code stops it."""


class Turns[O, A]:
    """Runs `work(turns)` in a thread that waits in `after(action)` while the world advances."""

    def __init__(self, work: Callable[["Turns[O, A]"], None]) -> None:
        self._work, self._ended = work, False
        self._observations: queue.SimpleQueue[O | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[A | BaseException | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def ask(self, observation: O) -> A | None:
        """The next action; None once the work has ended. Raises what the work raises."""
        if self._ended:
            return None
        self._observations.put(observation)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()
        answer = self._answers.get()
        self._ended = answer is None or isinstance(answer, BaseException)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def first(self) -> O:
        """Waits for the next observation. Raises Over at the end of the episode."""
        observation = self._observations.get()
        if observation is None:
            raise Over
        return observation

    def after(self, action: A) -> O:
        """The observation that follows. Raises Over."""
        self._answers.put(action)
        return self.first()

    def end(self) -> None:
        if self._thread is not None and self._thread.is_alive():
            self._observations.put(None)
            self._thread.join(JOIN_SECONDS)

    def _run(self) -> None:
        try:
            self._work(self)
            self._answers.put(None)
        except Over:
            return
        except BaseException as error:  # noqa: BLE001 (raised again by ask, in the asking thread)
            self._answers.put(error)
