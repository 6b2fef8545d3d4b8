"""A policy of this machine in a process of its own, reached by messages only."""

import os
import re
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from socket import socketpair

from pipeline.evaluate.policies.policy import NoAnswer, PolicyError, PolicyName
from pipeline.evaluate.serving.messages import LARGEST, MessageError, unpack
from pipeline.evaluate.serving.websocket import ConnectionLost, fault_of, last_line

CHILD = "pipeline.evaluate.child"

END_SECONDS = 2.0
"""For a process that closed its connection to end, so that its exit status is known."""

LOAD_SECONDS = 1800.0
"""For loading a policy."""

KEPT = {
    *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "TERM", "TZ", "TMPDIR", "VIRTUAL_ENV"),
    *("LD_LIBRARY_PATH", "HF_HOME", "HF_HUB_CACHE", "HF_HUB_OFFLINE", "LANG", "LANGUAGE"),
    "PYTHONHASHSEED",
}
PREFIXES = (
    *("LC_", "CUDA_", "NVIDIA_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_", "TORCH_", "PYTORCH_"),
    *("XLA_", "XDG_", "VK_", "ROCR_"),
)
"""Variables that the process gets, by name or beginning: secrets may have any other name."""


class Ended(ConnectionLost): ...


class Process:
    """The evaluator's end of a connection to a new process with a policy, whose process group ends
    with the connection or with the evaluator."""

    def __init__(self, name: PolicyName, *more: str) -> None:
        ours, theirs = socketpair()
        environment = {k: v for k, v in os.environ.items() if k in KEPT or k.startswith(PREFIXES)}
        if name.prints:
            name.prints.parent.mkdir(parents=True, exist_ok=True)
        with theirs, open(name.prints, "ab") if name.prints else nullcontext(2) as prints:
            process = subprocess.Popen(
                [sys.executable, "-u", "-P", "-m", CHILD, str(theirs.fileno()), name.text, *more],
                stdin=subprocess.DEVNULL,
                stdout=prints,  # what a policy prints is no part of a result
                stderr=prints,
                pass_fds=[theirs.fileno()],
                env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,
            )
        self._process, self._connection = process, Connection(ours.detach())
        self._end = weakref.finalize(self, _end, process, self._connection)
        self._late = False

    def ask(self, data: bytes, seconds: float) -> bytes:
        """As of MessageLink; a process that gives no answer in time is ended."""
        return self._exchange(data, seconds)

    def greet(self) -> bytes:
        """The first message, once the policy is loaded."""
        return self._exchange(None, LOAD_SECONDS)

    def close(self) -> None:
        self._end()

    def _exchange(self, data: bytes | None, seconds: float) -> bytes:
        # the policy's code may hold the other end in any way: only the end of the process is sure
        # to end the wait
        watch = threading.Timer(seconds, self._give_up)
        watch.daemon = True
        watch.start()
        try:
            if data is not None:
                self._connection.send_bytes(data)
            answer = self._connection.recv_bytes(LARGEST)
        except (EOFError, OSError) as error:
            late, self._late = self._late, False
            reason = NoAnswer(f"no answer in {seconds:.3g} s") if late else self._describe_end()
            raise reason from error
        finally:
            watch.cancel()
        if not answer.startswith(b"!"):
            return answer
        code, _, reason = answer[1:].decode(errors="replace").partition(" ")
        number = int(code) if re.fullmatch(r"\d{4}", code, re.ASCII) else None
        raise fault_of(last_line(reason), number)

    def _give_up(self) -> None:
        self._late = True
        _kill(self._process)

    def _describe_end(self) -> Ended:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_SECONDS)
        code = self._process.poll()
        if code is None:
            return Ended("the policy's process closed its connection")
        status = f"by signal {-code}" if code < 0 else f"with code {code}"
        return Ended(f"the policy's process ended {status}")


def refusal_frame(reason: str, code: int) -> bytes:
    """The frame of a process without an answer; a packed map never begins like this."""
    return f"!{code} {reason}".encode()


def _end(process: subprocess.Popen[bytes], connection: Connection) -> None:
    connection.close()
    _kill(process)
    with suppress(subprocess.TimeoutExpired):
        process.wait(END_SECONDS)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def host_policy(name: PolicyName, clients: int, wait: float) -> Iterator[PolicyName]:
    """The name under which so many clients at once reach the policy `name`, which answers in
    batches on a free port of loopback. Raises PolicyError for a policy that cannot be made, is no
    BatchPolicy, or is shown the simulation."""
    process = Process(name, str(clients), str(wait))
    try:
        port = unpack(process.greet()).get("port")
        if not isinstance(port, int):
            raise PolicyError(f"{name.label}: its process names no port")
        yield replace(name, text=f"ws://127.0.0.1:{port}", process="server", prints=None)
    except MessageError as error:
        raise PolicyError(f"{name.label}: its process names no port ({error})") from error
    finally:
        process.close()
