"""A policy of this process, for worker processes on this machine."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.data.setup import Setup
from pipeline.evaluate.names import make_policy
from pipeline.evaluate.policies.contract import declared, difference
from pipeline.evaluate.policies.policy import PolicyError, PolicyName, SeesTruth
from pipeline.evaluate.serving.batching import batcher_of
from pipeline.evaluate.serving.server import Limits, Place, PolicyServer
from pipeline.evaluate.serving.session import Domino

STOP_SECONDS = 10.0
"""What a policy may take to end its last answers before it is left behind."""


@contextmanager
def host_policy(name: PolicyName, setup: Setup, clients: int, wait: float) -> Iterator[PolicyName]:
    """The name under which so many worker processes reach the policy `name`, which is made here once and answers in batches.

    It listens on loopback, at a free port. Its label in results is that of `name`. Raises PolicyError for a policy that cannot be
    made, is no BatchPolicy, is shown the simulation, or was made for another setup.
    """
    policy = make_policy(name)
    if isinstance(policy, SeesTruth):
        raise PolicyError(f"{name.label}: is shown the simulation and cannot answer other processes: leave out --batch-wait")
    batcher = batcher_of(policy, name.label, wait)
    if reason := difference(declared(policy), setup):
        raise PolicyError(f"policy {name.label}: {reason}")
    server = PolicyServer(batcher.seat, Domino(name.label), Place(port=0), Limits(clients))

    with _running(server) as port:
        try:
            yield PolicyName(f"ws://127.0.0.1:{port}", name.label, name.probe)
        finally:
            batcher.close()


@contextmanager
def _running(server: PolicyServer) -> Iterator[int]:
    """The port of a server that runs in a thread."""
    loop, stop, up = asyncio.new_event_loop(), asyncio.Event(), threading.Event()

    def serve() -> None:
        try:
            loop.run_until_complete(server.serve(stop, lambda _: up.set()))
        finally:
            up.set()
            loop.close()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    up.wait()
    if not server.port:
        raise PolicyError("the policy cannot be served: no port of 127.0.0.1 is free")
    try:
        yield server.port
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(STOP_SECONDS)
