"""Episodes an hour of a policy that takes 5 ms for an answer or for a batch, by the number of
scenes at a time."""

import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.study.rows import markdown
from pipeline.crew.contract import SINGLE_THREAD, Crew
from pipeline.data.names import MOUNTED
from pipeline.data.setup import Setup
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.run.evaluation import runner

POLICY = '''
import time

from pipeline.evaluate.policies.policy import BatchPolicy


class Slow(BatchPolicy):
    """Holds still; an answer takes 5 ms on another processor, such as a GPU."""

    def begin(self, start):
        return None

    def act_together(self, asked):
        time.sleep(0.005)
        return [observation.joints for _, observation in asked]


def make_policy():
    return Slow()
'''
WAIT = 0.002
WORKERS = 6


@dataclass(frozen=True)
class Spent:
    """Control periods of one episode, and its processor time (s) in the worker."""

    periods: int
    processor: float


def time_episode(job: EpisodeJob) -> Spent:
    """The work of a worker."""
    began = time.process_time()
    return Spent(run_episode(job)["periods"], time.process_time() - began)


def table(case: Case, episodes: int = 6) -> str:
    """Markdown: a row a way, with its wall time here, its processor time, and what that allows on
    as many free cores as there are.

    On free cores a single scene waits for each answer; many scenes keep every core at work.
    """
    cores, body = len(os.sched_getaffinity(0)), []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "slow.py"
        path.write_text(POLICY)
        setup = Setup(cameras=MOUNTED[:1], textures="unseen")
        job = EpisodeJob(case, policy_name(str(path)), parse_clock("sim"), setup=setup)
        ways = (
            ("one scene at a time", Crew(), None),
            ("a copy of the policy in each worker", Crew("ray", cores), None),
            (f"one policy, {WORKERS} workers, batches", Crew("ray", WORKERS), WAIT),
        )
        for name, crew, wait in ways:
            spent, host, wall = _run([job] * episodes, crew, wait)
            periods = sum(one.periods for one in spent)
            step = (sum(one.processor for one in spent) + host) / periods
            busy = 1 if crew.executor == "inline" else cores
            rate = cores / step if wait is not None else busy / (step + 0.005)
            body.append(
                (
                    name,
                    f"{1000 * wall / periods:.1f}",
                    f"{1000 * step:.1f}",
                    f"{rate:.0f}",
                    f"{3600 * rate * len(spent) / periods:.0f}",
                )
            )
    head = (
        "scenes and policy",
        "wall ms a step",
        "processor ms a step",
        f"steps/s on {cores} free cores",
        "episodes/h",
    )
    return markdown(head, body)


@contextmanager
def _serve(policy: PolicyName, clients: int, wait: float) -> Iterator[int]:
    """The port of `serve-policy --batch-wait` in a process of its own."""
    command = ["domino-data", "serve-policy", policy.text, "--port", "0"]
    command += ["--clients", str(clients), "--batch-wait", str(1000 * wait)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            yield int(process.stdout.readline().rpartition(b":")[2])
        finally:
            process.terminate()


def _run(
    jobs: Sequence[EpisodeJob], crew: Crew, wait: float | None
) -> tuple[list[Spent], float, float]:
    """What each episode took, the processor time (s) of this process beside them, and the wall time
    (s) from the first end on."""
    for name, value in SINGLE_THREAD.items():
        os.environ[name] = value
    ends: list[tuple[float, float]] = []
    with ExitStack() as stack:
        policy = jobs[0].policy
        if wait is not None:
            port = stack.enter_context(_serve(policy, 2 * crew.workers, wait))
            policy = replace(policy, text=f"ws://127.0.0.1:{port}", process="server")
        warm = [replace(job, policy=policy) for job in [*jobs[: crew.workers], *jobs]]
        found = list[Spent]()
        for _, spent in runner(crew)(time_episode, warm):
            found.append(spent)
            ends.append((time.perf_counter(), time.process_time()))
    first = crew.workers
    beside = ends[-1][1] - ends[first - 1][1] if crew.executor != "inline" else 0.0
    return found[first:], beside, ends[-1][0] - ends[first - 1][0]
