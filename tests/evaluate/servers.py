"""A policy server in a thread of the test's process, and policies to put behind it."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import numpy as np

from pipeline.evaluate.policies.contract import Contract
from pipeline.evaluate.policies.policy import Start
from pipeline.evaluate.serving.server import Limits, Place, PolicyServer
from pipeline.evaluate.serving.session import Domino

NAMES = (*(f"left_{n}" for n in range(6)), "left_gripper")
START = Start("press the bell", "aloha-agilex", NAMES, 15, ("head_camera",), 7, {"head_camera": (6, 8)})


class Echo:
    """Answers with joints + the brightest pixel, twice; counts its episodes."""

    def __init__(self, contract=None):
        self.contract, self.starts = contract or Contract(), []

    def reset(self, start):
        self.starts.append(start)

    def act(self, observation):
        if observation.time > 100:
            raise KeyError("too late\nfor this")
        return np.repeat(observation.joints[None] + max(i.max() for i in observation.images.values()), 2, 0)


@contextmanager
def serving(make: Callable[[], Any] = Echo, token=None, language=None, tell=lambda line: None, **limits):
    """The port of a server of policies, which must still be running at the end."""
    wanted: dict[str, Any] = {"open_seconds": 10.0} | limits
    server = PolicyServer(make, language or Domino("echo"), Place(port=0, token=token), Limits(**wanted), tell)
    loop, stop, up = asyncio.new_event_loop(), asyncio.Event(), threading.Event()
    thread = threading.Thread(target=loop.run_until_complete, args=(server.serve(stop, lambda port: up.set()),))
    thread.start()
    assert up.wait(10)
    try:
        yield server.port
        assert thread.is_alive()
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(20)
        assert not thread.is_alive()
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()
