"""Ray for one run: on loopback with a token, or a joined cluster."""

import logging
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import chdir, contextmanager, redirect_stdout
from functools import cache
from typing import Any

from pipeline.data.errors import one_line
from pipeline.data.process.machine import PLUGINS

from .contract import SINGLE_THREAD, Crew, CrewError
from .signals import hold_signals

_ON_LOOPBACK = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""Ray reads it when imported. "0": no cluster of machines, everything listens on loopback."""

_SEES_GPUS = {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
"""An actor without a share of a GPU still sees it: SAPIEN renders on it."""

_STORE_BYTES = 80_000_000
"""Shared memory of the object store: jobs and results are small; Ray takes no less."""

_LONGEST = 21
"""Most characters of the directory for temporary files: a socket's path may have 107."""

_ANSWER_SECONDS = 10.0
_JOIN_SECONDS = 60.0  # for a process that imports Ray and joins the cluster
_ASK = "import sys, ray; ray.init(sys.argv[1], log_to_driver=False, configure_logging=False)"


@contextmanager
def session(crew: Crew) -> Iterator[None]:
    """Start Ray, or join `crew.address`; nothing if inline. Sessions nest. Raises CrewError."""
    if crew.executor == "inline":
        yield
        return
    if crew.address is None:
        os.environ.setdefault(_ON_LOOPBACK, "0")
    import ray

    if ray.is_initialized():
        yield
        return
    base = tempfile.gettempdir()
    folder = tempfile.mkdtemp(prefix="domino-ray-", dir=base if len(base) <= _LONGEST else "/tmp")
    with redirect_stdout(sys.stderr):  # Ray prints until its shutdown is over
        try:
            if crew.address is None:
                _start(crew.workers, folder)
            else:
                _join(crew.address, crew.runtime_env, folder)
            yield
        finally:
            with hold_signals():
                ray.shutdown()
            shutil.rmtree(folder, ignore_errors=True)


def _start(workers: int, folder: str) -> None:
    import ray

    options: dict[str, Any] = {
        "num_cpus": workers,
        "include_dashboard": False,
        "object_store_memory": _STORE_BYTES,
        "_temp_dir": folder,  # Ray leaves its logs there
    }
    threads = {name: os.environ.get(name, value) for name, value in SINGLE_THREAD.items()}
    with _environment(threads | _SEES_GPUS | {"RAY_AUTH_TOKEN": _token()}):
        _init("local", "Ray does not start", options, folder)
    if ray.util.get_node_ip_address() != "127.0.0.1":
        raise CrewError(
            "Ray was imported before this run and would listen on the network: set "
            f"{_ON_LOOPBACK}=0 before the import, or call ray.init() yourself"
        )


def _join(address: str, runtime_env: Mapping[str, Any], folder: str) -> None:
    from ray.runtime_env import RuntimeEnv

    plugins = {PLUGINS: os.environ[PLUGINS]} if PLUGINS in os.environ else {}
    try:
        given = dict(runtime_env.get("env_vars", {}))
        variables = SINGLE_THREAD | _SEES_GPUS | plugins | given
        environment: dict[str, Any] = dict(runtime_env) | {"env_vars": variables}
        RuntimeEnv(**environment)
    except Exception as error:  # each plugin of Ray has errors of its own
        raise CrewError(f"--runtime-env: {one_line(error)}") from error
    _check_cluster(address)
    if _token.cache_info().currsize:
        raise CrewError(
            f"--address {address}: this process has had a Ray of its own, whose token Ray keeps:"
            " join the cluster in a new process"
        )
    _init(address, f"no Ray cluster at {address}", {"runtime_env": environment}, folder)


def _init(address: str, failed: str, options: Mapping[str, Any], folder: str) -> None:
    """Start or join Ray, which replaces SIGTERM's handler. Workers import from `folder`."""
    import ray

    with hold_signals(), chdir(folder):
        try:
            ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **options)
        except Exception as error:  # Ray documents no others
            raise CrewError(f"{failed}: {one_line(error)}") from error


def _check_cluster(address: str) -> None:
    """Raise CrewError if no cluster answers: Ray would end this process."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535 or "//" in host:
        raise CrewError(
            f"--address {address} is not host:port: run the command on a machine of the cluster"
        )
    command, why = [sys.executable, "-P", "-c", _ASK, address], ""
    try:
        with socket.create_connection((host.strip("[]"), int(port)), _ANSWER_SECONDS):
            pass
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=_JOIN_SECONDS
        )
        if done.returncode:
            last = one_line(done.stderr.strip().rpartition("\n")[2])
            why = last or f"exit code {done.returncode}"
    except subprocess.TimeoutExpired:
        why = f"no answer for {_JOIN_SECONDS:.0f} s"
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
    if why:
        raise CrewError(
            f"no Ray cluster at {address} lets this command in: {why}; start one, name another"
            " --address, or set RAY_AUTH_MODE, RAY_AUTH_TOKEN and the version of Ray to the"
            " cluster's (docs/cluster.md)"
        )


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for Ray's processes only."""
    before = {name: os.environ.get(name) for name in [*values, "RAY_AUTH_MODE"]}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@cache
def _token() -> str:
    """The token of this process's Ray; Ray's own would be readable by others."""
    return secrets.token_hex(32)
