"""A Ray session for one run: on loopback, with a token of its own, and nothing left of it afterwards; or a cluster, joined."""

import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from pipeline.crew.guard import guard_directory
from pipeline.crew.pool import SINGLE_THREAD, EngineError, Pool
from pipeline.crew.signals import defer_signals

_LOOPBACK = "127.0.0.1"
_STORE_BYTES = 80_000_000
"""Shared memory of the object store: jobs and results are small and travel outside it; Ray takes no less."""
_LONGEST = 21
"""Most characters of the directory for temporary files: a socket's path may have 107, of which Ray's part and ours take 86."""


@contextmanager
def session(pool: Pool) -> Iterator[None]:
    """Ray is there within: started on this machine, or the cluster at `pool.address` joined; nothing for the inline executor.

    Sessions nest: where Ray runs in this process already, it is used and left as it is. Raises EngineError in one line.
    """
    if pool.executor == "inline":
        yield
        return
    import ray

    if ray.is_initialized():
        yield
        return
    from ray._private import utils, worker

    with (
        # Ray prints about lost workers to standard output, which belongs to the result of the command
        _replace(worker, "print_to_stdstream", lambda *_, **__: None),
        # and would end the process by itself on SIGTERM
        _replace(utils, "set_sigterm_handler", lambda _: None),
        _join(pool.address, pool.runtime_env) if pool.address else _local(pool.workers),
    ):
        yield


@contextmanager
def _local(workers: int) -> Iterator[None]:
    import ray
    from ray._private import ray_constants
    from ray._private.node import Node
    from ray._raylet import AuthenticationTokenLoader, Config  # pyright: ignore[reportAttributeAccessIssue]  (compiled, no stubs)

    threads = {name: os.environ.get(name, value) for name, value in SINGLE_THREAD.items()}
    # an actor without a share of a GPU must still see it: SAPIEN draws on it
    environment = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32), "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}

    def reload_token() -> None:
        # in this order: a thread that still talks must not look for a token that is gone
        Config.initialize("")
        AuthenticationTokenLoader.instance().reset_cache()

    folder = _directory()
    with ExitStack() as cleared:
        cleared.callback(shutil.rmtree, folder, ignore_errors=True)
        # Ray replaces 127.0.0.1 by the machine's address, except where it believes that clusters are not supported
        cleared.enter_context(_replace(ray_constants, "ENABLE_RAY_CLUSTER", False))
        # one machine for one run needs none of them: autoscaler, tail of logs, server of the jobs API; 2 s and 300 MB in all
        for unneeded in ("start_monitor", "start_log_monitor", "start_api_server"):
            cleared.enter_context(_replace(Node, unneeded, lambda *_, **__: None))
        try:
            with _environment(threads | environment), defer_signals():
                reload_token()
                ray.init(
                    address="local",
                    num_cpus=workers,
                    include_dashboard=False,
                    object_store_memory=_STORE_BYTES,
                    log_to_driver=False,
                    configure_logging=False,
                    _node_ip_address=_LOOPBACK,
                    # below one that is ours alone: Ray opens its own, with its sockets, to everybody
                    _temp_dir=str(folder / "r"),
                )
                cleared.enter_context(guard_directory(folder, "raylet"))
                if ray.util.get_node_ip_address() != _LOOPBACK:
                    raise EngineError(
                        f"Ray {ray.__version__} does not stay on loopback: install the version that the lock file names"
                    )
            yield
        finally:
            with defer_signals():
                ray.shutdown()
                reload_token()


@contextmanager
def _join(address: str, wanted: Mapping[str, Any]) -> Iterator[None]:
    import ray
    from ray.exceptions import RayError
    from ray.runtime_env import RuntimeEnv

    # an actor without a share of a GPU must still see it: SAPIEN draws on it
    variables = SINGLE_THREAD | {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"} | dict(wanted.get("env_vars", {}))
    environment: dict[str, Any] = dict(wanted) | {"env_vars": variables}
    try:
        RuntimeEnv(**environment)
    except Exception as error:  # each plugin of Ray has errors of its own
        raise EngineError(f"--runtime-env: {' '.join(str(error).split())}") from error
    check_cluster(address)
    try:
        with defer_signals():
            try:
                ray.init(address=address, log_to_driver=False, configure_logging=False, runtime_env=environment)
            except (ConnectionError, RuntimeError, ValueError, RayError) as error:
                raise EngineError(describe_refusal(address, error)) from error
        yield
    finally:
        with defer_signals():
            ray.shutdown()


def _directory() -> Path:
    """A new directory for Ray's sockets and logs, with a path that is short enough."""
    base = tempfile.gettempdir()
    return Path(tempfile.mkdtemp(prefix="domino-ray-", dir=base if len(base) <= _LONGEST else "/tmp"))


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables set within."""
    found = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in found.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _replace(owner: object, name: str, value: object) -> Iterator[None]:
    """An attribute of a module or class replaced within."""
    found = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, found)


_ANSWER_SECONDS = 10.0
_JOIN_SECONDS = 45.0  # for a process that imports Ray and asks the cluster, on a machine with much to do
_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""How a client of HTTP/2, which gRPC and so Ray speaks, begins: the fixed text and a frame of no settings (RFC 9113, 3.4)."""

_SETTINGS = 4  # the kind of frame that a server of HTTP/2 begins with
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
