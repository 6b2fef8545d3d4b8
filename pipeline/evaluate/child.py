"""The process of a policy; it answers messages until its caller ends: python -m pipeline.evaluate.child DESCRIPTOR TEXT LABEL."""

import os
import select
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection

from pipeline.data.errors import DominoError
from pipeline.evaluate.names import make_policy
from pipeline.evaluate.policies.policy import PolicyError, PolicyName, SeesTruth, staying
from pipeline.evaluate.serving.server import call_policy, fault_of
from pipeline.evaluate.serving.session import Domino
from pipeline.evaluate.serving.wire import WireError, pack, unpack


def serve(connection: Connection, name: PolicyName) -> None:
    """Make the policy of a name and answer messages about it. Raises EOFError or OSError when the connection ends."""
    language = Domino(name.label)
    try:
        policy = make_policy(name)
        if isinstance(policy, SeesTruth):
            raise PolicyError(f"{name.label}: is shown the simulation and cannot run in a process of its own: add --in-process")
        session = language.session(policy)
        connection.send_bytes(pack(call_policy(session.greeting)))
    except DominoError as error:
        connection.send_bytes(language.error(str(error), ""))
        return
    while True:
        data = connection.recv_bytes()
        try:
            answer = call_policy(lambda data=data: pack(session.answer(unpack(data))))
        except WireError as error:
            answer = language.error(str(error), "")
        except DominoError as error:
            answer = language.error(str(error), fault_of(error))
        connection.send_bytes(answer)


def _end_with_caller(descriptor: int, leave: Callable[[int], object]) -> None:
    """Wait until the other end of the connection is closed, then end this process, whatever the policy does."""
    poll = select.poll()
    poll.register(descriptor, 0)
    poll.poll()
    leave(1)


def main() -> None:
    """Serve the policy that the command line names."""
    descriptor, text, label = sys.argv[1:]
    threading.Thread(target=_end_with_caller, args=(int(descriptor), os._exit), daemon=True).start()
    # the connection ends when the caller does
    with staying(), suppress(EOFError, OSError):
        serve(Connection(int(descriptor)), PolicyName(text, label))


if __name__ == "__main__":
    main()
