"""A policy in a process of its own, reached by messages only."""

import os
import signal
import subprocess
import sys
import threading
import weakref
from contextlib import nullcontext, suppress
from multiprocessing.connection import Connection
from socket import socketpair

from pipeline.evaluate.policies.policy import NoAnswer, PolicyName

from .messages import LARGEST
from .websocket import ConnectionLost, fault_of, last_line

END_SECONDS = 2.0
"""For a process that closed its connection to end, so that its exit status is known."""

LOAD_SECONDS = 1800.0

KEPT = {
    *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "TERM", "TZ", "TMPDIR", "VIRTUAL_ENV"),
    *("LD_LIBRARY_PATH", "HF_HOME", "HF_HUB_CACHE", "HF_HUB_OFFLINE", "LANG", "LANGUAGE"),
    "PYTHONHASHSEED",
}
PREFIXES = (
    *("LC_", "CUDA_", "NVIDIA_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_", "TORCH_", "PYTORCH_"),
    *("XLA_", "XDG_", "VK_", "ROCR_"),
)
"""Variables that the process gets: secrets may have any other name."""


class Process:
    """A process with a policy, which ends with the connection or if an answer is late."""

    def __init__(self, name: PolicyName) -> None:
        ours, theirs = socketpair()
        environment = {k: v for k, v in os.environ.items() if k in KEPT or k.startswith(PREFIXES)}
        command = [sys.executable, "-u", "-P", "-m", "pipeline.evaluate.child"]
        if name.prints:
            name.prints.parent.mkdir(parents=True, exist_ok=True)
        with theirs, open(name.prints, "ab") if name.prints else nullcontext(2) as prints:
            process = subprocess.Popen(
                [*command, str(theirs.fileno()), name.text],
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

    def greet(self) -> bytes:
        return self.ask(None, LOAD_SECONDS)

    def close(self) -> None:
        self._end()

    def ask(self, data: bytes | None, seconds: float) -> bytes:
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
        raise fault_of(last_line(reason), int(code) if code.isdecimal() else None)

    def _give_up(self) -> None:
        self._late = True
        _kill(self._process)

    def _describe_end(self) -> ConnectionLost:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_SECONDS)
        code = self._process.poll()
        if code is None:
            return ConnectionLost("the policy's process closed its connection")
        status = f"by signal {-code}" if code < 0 else f"with code {code}"
        return ConnectionLost(f"the policy's process ended {status}")


def refusal_frame(reason: str, code: int) -> bytes:
    """A packed map never begins like this."""
    return f"!{code} {reason}".encode()


def _end(process: subprocess.Popen[bytes], connection: Connection) -> None:
    connection.close()
    _kill(process)
    with suppress(subprocess.TimeoutExpired):
        process.wait(END_SECONDS)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
