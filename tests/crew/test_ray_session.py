"""A run's Ray listens on loopback only, answers nobody without its token, and leaves nothing behind however its driver ends."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from pipeline.crew.contract import Crew
from pipeline.crew.ray_session import session
from pipeline.data.dataset import Dataset
from pipeline.run.doctor.alive import RAY, judge_ray
from pipeline.run.verify.dataset import verify
from tests.run.processes import below, listening, of_session, shared_memory, title, wait_for, workers

ROOT = Path(__file__).parents[3]
LEFTOVER = "127.0.0.1:1"
"""Where the leftover cluster says that it is; nobody listens there."""

DRIVER = """
import sys, time
from collections import deque
from pipeline.crew.loop import run
from pipeline.crew.contract import Limit, Crew
from pipeline.crew.signals import Stopped, stop_on_signal

def make():
    return time.sleep

try:
    with stop_on_signal():
        print("up", flush=True)
        for end in run(make, deque([600] * 4), Crew("ray", 2), Limit(lambda _: 600)):
            pass
except Stopped:
    print("stopped", flush=True)
    sys.exit(130)
"""

CLIENT = """
import sys
from ray._raylet import GcsClient
print("in", len(GcsClient(address=sys.argv[1]).internal_kv_keys(b"", None, 10)))
"""


def driver() -> subprocess.Popen[str]:
    """A driver in a session of its own, with two workers that sleep."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER], env=os.environ | {"PYTHONPATH": str(ROOT)}, start_new_session=True, **pipes
    )
    wait_for(lambda: len([pid for pid in workers(of_session(process.pid)) if title(pid).endswith((".start", ".go_on"))]) == 2, 120)
    return process


def directory(pids: list[int]) -> Path:
    """Where Ray, started by these processes, keeps its sockets and logs."""
    (found,) = {match[0] for pid in pids if (match := re.search(r"/[^ =]*/domino-ray-\w+", title(pid)))}
    return Path(found)


def token(pids: list[int]) -> str:
    """The token that Ray, started by these processes, asks for."""
    (raylet,) = [pid for pid in pids if title(pid).split(" ")[0].endswith("raylet")]
    pairs = Path(f"/proc/{raylet}/environ").read_text().split("\0")
    return next(pair.removeprefix("RAY_AUTH_TOKEN=") for pair in pairs if pair.startswith("RAY_AUTH_TOKEN="))


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where the control service of a session listens.

    The session runs beside what a `ray start --head` leaves behind: RAY_ADDRESS, and the file in which Ray looks up the cluster.
    """
    leftover = tmp_path_factory.mktemp("leftover")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_ADDRESS", LEFTOVER)
        patch.setenv("RAY_TMPDIR", str(leftover))
        from ray._common.utils import get_ray_address_file
        from ray._private.utils import read_ray_address

        file = Path(get_ray_address_file(None))
        file.parent.mkdir(exist_ok=True)
        file.write_text(LEFTOVER)
        assert leftover in file.parents and read_ray_address() == LEFTOVER
        with session(Crew("ray", 2)):
            import ray

            yield ray.get_runtime_context().gcs_address
        assert file.read_text() == LEFTOVER


def test_a_leftover_cluster_is_not_joined(address: str):
    import ray

    assert address != LEFTOVER
    assert ray.get(ray.remote(lambda: 7).remote()) == 7


@pytest.mark.usefixtures("address")
def test_the_doctor_hears_a_worker(capsys: pytest.CaptureFixture[str]):
    exec(RAY, {})
    assert judge_ray(json.loads(capsys.readouterr().out)).verdict == "PASS"


@pytest.mark.usefixtures("address")
def test_workers_that_verify_find_what_one_process_finds(built: Path, tmp_path: Path):
    dataset = Path(shutil.copytree(built, tmp_path / "out"))
    damaged = sorted(dataset.glob("episodes/**/*.hdf5"))[1]
    damaged.write_bytes(damaged.read_bytes()[:5000])
    # verify notes in the ledger what it finds, so each has a copy of its own, at a path of the same length
    other = Path(shutil.copytree(dataset, tmp_path / "two"))
    found = verify(Dataset(dataset), Crew("ray", 2))
    assert not found["ok"] and found["episodes"] == 2
    assert found == verify(Dataset(other))


def test_everything_listens_on_loopback(address: str):
    import ray

    ray.get(ray.remote(lambda: 1).remote())
    # control service, raylet (two), its agent, this driver, a worker; the agent starts after the first task may have ended
    wait_for(lambda: len(listening(below(os.getpid()))) >= 6, 60)
    found = listening(below(os.getpid()))
    assert int(address.split(":")[1]) in {port for _, port in found}
    assert {host for host, _ in found} <= {"127.0.0.1", "::1", "::ffff:127.0.0.1"}


def test_a_client_without_the_token_is_refused(address: str):
    def client(**environment: str) -> subprocess.CompletedProcess[str]:
        clean = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
        command = [sys.executable, "-c", CLIENT, address]
        return subprocess.run(command, env=clean | environment, capture_output=True, text=True, timeout=120, check=False)

    mine = token(below(os.getpid()))
    assert len(mine) == 64
    assert "RAY_AUTH_TOKEN" not in os.environ
    assert client(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=mine).stdout.startswith("in ")
    for environment in ({"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "0" * 64}, {"RAY_AUTH_MODE": "disabled"}):
        refused = client(**environment)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "AuthenticationError" in refused.stderr
    # the one service that speaks HTTP: it would install packages and set variables for whoever asks
    (agent,) = [pid for pid in below(os.getpid()) if title(pid) == "ray::RuntimeEnvAgent"]
    ((_, port),) = listening([agent])
    for path in ("get_or_create_runtime_env", "get_runtime_envs_info"):
        with pytest.raises(HTTPError, match="401"):
            urlopen(f"http://127.0.0.1:{port}/{path}", data=b"", timeout=30)


@pytest.mark.parametrize(
    ("number", "group", "again", "stopped_worker"),
    [
        (signal.SIGTERM, False, False, False),
        (signal.SIGINT, True, True, True),
        (signal.SIGKILL, False, False, True),
    ],
    ids=["terminated", "interrupted twice", "killed"],
)
@pytest.mark.usefixtures("address")
def test_nothing_is_left_of_a_driver(number: int, group: bool, again: bool, stopped_worker: bool):
    shared = shared_memory()
    process = driver()
    mine = directory(of_session(process.pid))
    assert mine.stat().st_mode & 0o777 == 0o700
    its = of_session(process.pid)
    assert token(its) != token([pid for pid in below(os.getpid()) if pid not in its])
    if stopped_worker:
        os.kill(workers(of_session(process.pid))[0], signal.SIGSTOP)
    # Ctrl-C reaches everything in the terminal's foreground
    os.killpg(process.pid, number) if group else os.kill(process.pid, number)
    if again:
        wait_for(lambda: process.poll() is not None or len(workers(of_session(process.pid))) < 2)
        process.send_signal(number)
    out, err = process.communicate(timeout=60)
    if number == signal.SIGKILL:
        assert process.returncode == -number
        wait_for(lambda: not of_session(process.pid), 20)
        wait_for(lambda: not mine.exists(), 20)
    else:
        assert (process.returncode, out.split(), err) == (130, ["up", "stopped"], "")
        assert not of_session(process.pid)
    assert not mine.exists()
    assert wait_for(lambda: shared_memory() <= shared)
