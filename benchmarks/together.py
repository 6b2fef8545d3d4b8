"""Episodes an hour of a policy that takes 5 ms for an answer or for a batch, by the number of
scenes at a time. Also where the processor time of a step goes."""

import os
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.study.rows import markdown
from pipeline.crew.contract import SINGLE_THREAD, Crew
from pipeline.data.setup import Setup
from pipeline.evaluate.actions import interpolate_targets
from pipeline.evaluate.episode import EpisodeJob, run_episode, start_of
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.policies.policy import Policy, PolicyName, observe
from pipeline.evaluate.scenes.case import Case, expert_actions
from pipeline.evaluate.scenes.trial import Eyes, Trial, instruction_of
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.client import full_message
from pipeline.evaluate.serving.messages import pack, unpack
from pipeline.run.evaluation import runner
from pipeline.stages.scene import build_scene

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
ANSWER = 0.005
"""s of an answer or a batch of them, see POLICY."""
NETWORK = "network, on this processor"


@dataclass(frozen=True)
class Spent:
    """Control periods of one episode, and its processor time (s) in the worker."""

    periods: int
    processor: float


def time_episode(job: EpisodeJob) -> Spent:
    """The work of a worker."""
    began = time.process_time()
    return Spent(run_episode(job)["periods"], time.process_time() - began)


def table(case: Case, setup: Setup, episodes: int = 6) -> str:
    """Markdown: a row a way, with its wall time here, its processor time, and what that allows on
    as many free cores as there are.

    On free cores a single scene waits for each answer; many scenes keep every core at work.
    """
    cores, body = len(os.sched_getaffinity(0)), []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "slow.py"
        path.write_text(POLICY)
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
            rate = cores / step if wait is not None else busy / (step + ANSWER)
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


def parts(case: Case, setup: Setup, network: Policy | None = None, repeats: int = 5) -> str:
    """Markdown: processor ms of a step by part, the least of some repeats, and the highest ratio of
    many scenes to one that these leave."""
    actions, found = np.array(expert_actions(case)), list[dict[str, float]]()
    for _ in range(repeats):
        spent: dict[str, float] = defaultdict(float)
        trial = Trial(build_scene(case.spec), case.target_motion, setup)
        bare = build_scene(case.spec).start(case.target_motion, setup.fps, "evaluate").simulation
        eyes = Eyes(trial.scene, setup)
        if network is not None:
            words = instruction_of(trial.scene)
            network.reset(start_of(trial.scene.embodiment, setup, words))
        for action in actions:
            if trial.ending:
                break
            with _counted(spent, "images"):
                seen = observe(trial, eyes, "")
            with _counted(spent, "messages to and from a server"):
                unpack(pack(full_message(seen)))
            if network is not None:
                with _counted(spent, NETWORK):
                    network.act(seen)
            before = bare.command
            rows, velocity = interpolate_targets(
                before, np.asarray(action), trial.per_period, 1 / trial.fps
            )
            with _counted(spent, "physics"):
                for row in rows:
                    bare.step(row, velocity)
            with _counted(spent, "physics, recorded and judged"):
                trial.advance(action)
        eyes.close()
        found.append({name: 1000 * s / len(trial.commanded) for name, s in spent.items()})
    least = {name: min(one[name] for one in found) for name in found[0]}
    judged = least.pop("physics, recorded and judged")
    least["contacts, recording and judging"] = judged - least["physics"]
    answers = {f"{ms} ms elsewhere": ms for ms in (5, 10, 20, 50)}
    if NETWORK in least:
        answers |= {"the network here, if a batch costs nothing": least[NETWORK]}
    scene = sum(ms for name, ms in least.items() if name != NETWORK)
    total, cores = sum(least.values()), len(os.sched_getaffinity(0))
    body = [(name, f"{ms:.2f}", f"{100 * ms / total:.0f}") for name, ms in sorted(least.items())]
    most = [(name, f"{cores * (scene + answer) / scene:.1f}") for name, answer in answers.items()]
    return "\n\n".join(
        (
            markdown(("part", "processor ms", "%"), body),
            markdown(("an answer takes", f"highest ratio on {cores} cores"), most),
        )
    )


@contextmanager
def _counted(spent: dict[str, float], name: str) -> Iterator[None]:
    began = time.process_time()
    yield
    spent[name] += time.process_time() - began


@contextmanager
def _serve(policy: PolicyName, clients: int, wait: float) -> Iterator[tuple[int, int]]:
    """The port and process id of `serve-policy --batch-wait` in a process of its own."""
    command = ["domino-data", "serve-policy", policy.text, "--port", "0"]
    command += ["--clients", str(clients), "--batch-wait", str(1000 * wait)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            yield int(process.stdout.readline().rpartition(b":")[2]), process.pid
        finally:
            process.terminate()


def _run(
    jobs: Sequence[EpisodeJob], crew: Crew, wait: float | None
) -> tuple[list[Spent], float, float]:
    """What each episode took. Beside them the processor time (s) of this process and of the server,
    and the wall time (s), both from the first end on."""
    for name, value in SINGLE_THREAD.items():
        os.environ[name] = value
    ends: list[tuple[float, float]] = []
    server = 0
    with ExitStack() as stack:
        policy = jobs[0].policy
        if wait is not None:
            port, server = stack.enter_context(_serve(policy, 2 * crew.workers, wait))
            policy = replace(policy, text=f"ws://127.0.0.1:{port}", process="server")
        warm = [replace(job, policy=policy) for job in [*jobs[: crew.workers], *jobs]]
        found = list[Spent]()
        for _, spent in runner(crew)(time_episode, warm):
            found.append(spent)
            ends.append((time.perf_counter(), time.process_time() + _processor(server)))
    first = crew.workers
    beside = ends[-1][1] - ends[first - 1][1] if crew.executor != "inline" else 0.0
    return found[first:], beside, ends[-1][0] - ends[first - 1][0]


def _processor(process: int) -> float:
    """Processor seconds of another process so far, 0 without one."""
    if not process:
        return 0.0
    user, system = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
