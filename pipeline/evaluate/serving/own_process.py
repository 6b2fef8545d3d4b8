"""A policy of this machine in a process of its own: only messages of this project's protocol pass between it and the evaluator."""

import os
import signal
import subprocess
import sys
import weakref
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from multiprocessing.connection import Connection
from socket import socketpair
from typing import Any

from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.policy import Gone, PolicyName
from pipeline.evaluate.serving.client import Channel, Client
from pipeline.evaluate.serving.session import contract_of
from pipeline.evaluate.serving.socket import Lost
from pipeline.evaluate.serving.wire import LARGEST, WireError, pack, unpack

CHILD = "pipeline.evaluate.child"
"""The module that the process runs."""

END_SECONDS = 2.0
"""How long a process that closed its connection may take to end, so that its exit status is known."""


class Ended(Gone, Lost):
    """The process has ended."""


class OwnProcess(Client):
    """The policy of a name, made in a process of its own.

    Has the policy's `contract` and `setup`. Raises PolicyError if the policy cannot be made or is shown the simulation.
    """

    def __init__(self, name: PolicyName) -> None:
        super().__init__("")
        self._name = name
        self._opened: tuple[Channel, dict[object, object]] | None = self._open()
        offer = self._opened[1]
        self.contract, self.setup = contract_of(offer.get("contract")), offer.get("setup")

    def close(self) -> None:
        """End the process, and those that it has started."""
        super().close()
        self._channel.close()
        self._opened = None

    def _connect(self) -> Channel:
        self._channel = _Pipe(self._name)
        return self._channel

    def _open(self) -> tuple[Channel, dict[object, object]]:
        opened, self._opened = getattr(self, "_opened", None), None
        return opened or super()._open()

    def _fail(self) -> None:
        """The process stays: the policy keeps what it has loaded."""


class _Pipe:
    """A new process with a policy, and the connection to it. Time limits are the caller's."""

    def __init__(self, name: PolicyName) -> None:
        ours, theirs = socketpair()
        if name.prints:
            name.prints.parent.mkdir(parents=True, exist_ok=True)
        with theirs, open(name.prints, "ab") if name.prints else nullcontext(2) as prints:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", CHILD, str(theirs.fileno()), name.text, name.label],
                stdin=subprocess.DEVNULL,
                stdout=prints,  # what a policy prints is no part of a result
                stderr=prints,
                pass_fds=[theirs.fileno()],
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,
            )
        self._process, self._connection = process, Connection(ours.detach())
        self._finalizer = weakref.finalize(self, _end, process, self._connection)

    def ask(self, message: Mapping[str, Any]) -> dict[Any, Any]:
        """Send a message and wait for the answer. Raises Ended if the process ends, ActionError for bytes that are no message."""
        try:
            self._connection.send_bytes(pack(message))
        except OSError as error:
            raise self._describe_end() from error
        return self.receive()

    def close(self) -> None:
        """End the process, and those that it has started."""
        self._finalizer()

    def receive(self, _seconds: float = 0.0, /) -> dict[Any, Any]:
        """The next message, however long it takes. Raises as `ask`."""
        try:
            return unpack(self._connection.recv_bytes(LARGEST))
        except (EOFError, OSError) as error:
            raise self._describe_end() from error
        except WireError as error:
            raise ActionError(str(error)) from error

    def _describe_end(self) -> Ended:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_SECONDS)
        code = self._process.poll()
        status = "closed its connection" if code is None else f"ended by signal {-code}" if code < 0 else f"ended with code {code}"
        return Ended(f"the policy's process {status}")


def _end(process: subprocess.Popen[bytes], connection: Connection) -> None:
    connection.close()
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
