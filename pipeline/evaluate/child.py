"""The process of a policy, until its caller ends: python -m pipeline.evaluate.child DESCRIPTOR
TEXT."""

import os
import select
import signal
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection

from .names import make_here
from .policies.policy import PolicyError, PolicyName, SeesTruth
from .serving.messages import pack
from .serving.process import refusal_frame
from .serving.session import ServerOptions, Session, guarded, respond


def serve(connection: Connection, text: str) -> None:
    def session_of() -> Session:
        policy = make_here(PolicyName(text, text))
        if isinstance(policy, SeesTruth):
            raise PolicyError(f"--policy {text}: is shown the simulation: add --in-process")
        return Session(policy, ServerOptions("policy"))

    session = guarded(session_of)
    answer = session if isinstance(session, tuple) else guarded(lambda: pack(session.metadata()))
    _send(connection, answer)
    while isinstance(session, Session) and isinstance(answer, bytes):
        _send(connection, respond(session, connection.recv_bytes()))


def _send(connection: Connection, answer: bytes | tuple[str, int]) -> None:
    connection.send_bytes(refusal_frame(*answer) if isinstance(answer, tuple) else answer)


def _end_with_caller(descriptor: int) -> None:
    poll = select.poll()
    poll.register(descriptor, 0)
    poll.poll()
    os.killpg(0, signal.SIGKILL)


def main() -> None:
    descriptor, text = int(sys.argv[1]), sys.argv[2]
    threading.Thread(target=_end_with_caller, args=(descriptor,), daemon=True).start()
    # the connection ends when the caller does
    with suppress(EOFError, OSError):
        serve(Connection(descriptor), text)


if __name__ == "__main__":
    main()
