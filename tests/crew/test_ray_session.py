"""Ray of a run: on loopback, for nobody without its token, and gone after the run."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from pipeline.crew import ray_session
from pipeline.crew.contract import Crew, CrewError
from pipeline.crew.ray_session import session
from pipeline.run.checks.doctor import RAY, judge_ray
from tests.run.processes import below, listening, of_session, title, wait_for, workers

ROOT = Path(__file__).parents[2]

DRIVER = """
import sys, time
from collections import deque
from pipeline.crew.contract import Crew
from pipeline.crew.loop import run
from pipeline.crew.signals import Stopped, stop_on_signal

try:
    with stop_on_signal():
        for end in run(lambda: time.sleep, deque([600] * 4), Crew("ray", 2), 600):
            pass
except Stopped:
    print("stopped", flush=True)
    sys.exit(130)
"""


def environment(pid: int) -> dict[str, str]:
    """The environment of a process."""
    pairs = Path(f"/proc/{pid}/environ").read_text().split("\0")
    return dict(pair.split("=", 1) for pair in pairs if "=" in pair)


@pytest.fixture(scope="module")
def ray() -> Iterator[list[int]]:
    """The processes of a session, which does not join the cluster that RAY_ADDRESS names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_ADDRESS", "127.0.0.1:1")
        with session(Crew("ray", 2)):
            import ray

            assert ray.get(ray.remote(lambda: 7).remote()) == 7
            yield below(os.getpid())


def test_everything_listens_on_loopback(ray: list[int]):
    wait_for(lambda: len(listening(below(os.getpid()))) >= 5, 60)
    hosts = {host for host, _ in listening(below(os.getpid()))}
    assert hosts <= {"127.0.0.1", "::1", "::ffff:127.0.0.1"}


def test_a_client_without_the_token_is_refused(ray: list[int]):
    assert "RAY_AUTH_TOKEN" not in os.environ
    (raylet,) = [pid for pid in ray if title(pid).split(" ")[0].endswith("raylet")]
    assert len(environment(raylet)["RAY_AUTH_TOKEN"]) == 64
    # the one service that speaks HTTP: it would install packages for whoever asks
    (agent,) = [pid for pid in ray if title(pid) == "ray::RuntimeEnvAgent"]
    ((_, port),) = listening([agent])
    with pytest.raises(HTTPError, match="401"):
        urlopen(f"http://127.0.0.1:{port}/get_runtime_envs_info", data=b"", timeout=30)


@pytest.mark.usefixtures("ray")
def test_the_doctor_hears_a_worker(capsys: pytest.CaptureFixture[str]):
    exec(RAY, {})
    assert judge_ray(json.loads(capsys.readouterr().out)).verdict == "PASS"


@pytest.fixture
def folder() -> Iterator[Path]:
    """A directory with a path that is short enough for sockets."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        yield Path(name)


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)],
    ids=["stopped", "killed"],
)
def test_nothing_works_on_after_its_driver(number: int, folder: Path, tmp_path: Path):
    """Workers start where the command does and import nothing from there: a received dataset may
    hold a file named like a package."""
    (tmp_path / "pipeline.py").write_text("raise SystemExit('a stranger')")
    variables = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(folder)}
    del variables["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"]
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", DRIVER],
        env=variables,
        cwd=tmp_path,
        start_new_session=True,
        stdout=subprocess.PIPE,
        text=True,
    )

    def at_work() -> list[int]:
        found = workers(of_session(process.pid))
        return [pid for pid in found if title(pid).endswith(".start")]

    wait_for(lambda: len(at_work()) == 2, 120)
    assert {os.readlink(f"/proc/{pid}/cwd") for pid in at_work()} == {str(tmp_path)}
    os.kill(at_work()[0], signal.SIGSTOP)
    # Ctrl-C reaches everything in the terminal's foreground
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    out, _ = process.communicate(timeout=60)
    if number == signal.SIGKILL:
        # Ray's agents stay for up to two minutes
        wait_for(lambda: not workers(of_session(process.pid)), 20)
        for pid in of_session(process.pid):
            os.kill(pid, signal.SIGKILL)
    else:
        assert (process.returncode, out) == (130, "stopped\n")
        wait_for(lambda: not of_session(process.pid), 20)
        assert not list(folder.iterdir())


@pytest.mark.usefixtures("ray")
def test_a_process_that_had_its_own_ray_is_told_to_join_a_cluster_in_another(monkeypatch):
    import ray

    ray.shutdown()  # the last test of this module
    monkeypatch.setattr(ray_session, "_check_cluster", lambda address: None)
    joined = session(Crew("ray", 2, address="127.0.0.1:6379"))
    with pytest.raises(CrewError, match="join the cluster in a new process"), joined:
        pass
