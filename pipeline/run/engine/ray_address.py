"""Whether a Ray cluster answers at an address: asked in seconds, because Ray itself would try for minutes and print its C++ log."""

import socket
import subprocess
import sys

from pipeline.run.engine.pool import EngineError

_ANSWER_SECONDS = 10.0
_JOIN_SECONDS = 45.0
"""For a process that imports Ray and asks the cluster, on a machine with much to do."""

_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""How a client of HTTP/2, which gRPC and so Ray speaks, begins: the fixed text and a frame of no settings (RFC 9113, 3.4)."""

_SETTINGS = 4
"""The kind of frame that a server of HTTP/2 begins with."""

_ASK = "import sys; from ray._raylet import GcsClient; GcsClient(address=sys.argv[1]).internal_kv_get(b'session_name', b'session')"


def check_cluster(address: str) -> None:
    """Raise EngineError, in one line, if no Ray cluster answers at `address` (host:port) or it refuses this user."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535 or "//" in host:
        raise EngineError(f"--address {address} is not host:port: run the command on a machine of the cluster")
    fix = "start one (docs/cluster.md), or name another --address"
    try:
        with socket.create_connection((host.strip("[]"), int(port)), _ANSWER_SECONDS) as connection:
            connection.sendall(_PREFACE)
            frame = connection.makefile("rb").read(9)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise EngineError(f"no Ray cluster at {address}: {why}; {fix}") from error
    if len(frame) < 9 or frame[3] != _SETTINGS:
        raise EngineError(f"no Ray cluster at {address}: what answers there is something else; {fix}")
    try:
        done = subprocess.run(
            [sys.executable, "-c", _ASK, address], capture_output=True, text=True, timeout=_JOIN_SECONDS, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise EngineError(f"no Ray cluster at {address}: it has not answered for {_JOIN_SECONDS:.0f} s; {fix}") from error
    if done.returncode:
        raise EngineError(describe_refusal(address, done.stderr.strip().rpartition("\n")[2]))


def describe_refusal(address: str, why: object) -> str:
    """The message for a cluster that cannot be joined."""
    return (
        f"no Ray cluster at {address} lets this command in: {' '.join(str(why).split())[:300]}; RAY_AUTH_MODE, RAY_AUTH_TOKEN and "
        "the version of Ray must be those that it was started with (docs/cluster.md)"
    )
