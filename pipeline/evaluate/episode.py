"""One evaluated episode and its row of results."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pipeline.data.setup import Setup
from pipeline.data.spec import CONTROL
from pipeline.poses import Floats
from pipeline.world.cameras import setup_cameras
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import Embodiment

from .actions import ActionError
from .asking import AskedPolicy
from .policies.policy import (
    NoAnswer,
    PolicyError,
    PolicyName,
    Start,
    attribute,
    observe,
    policy_seed,
)
from .scenes.case import BLIND, Case, start_of_trial
from .scenes.trial import INVALID_ACTION, NO_ANSWER, Eyes, Trial, instruction_now, instruction_of
from .scoring.clock import Clock, drive_overlapped, in_turn
from .scoring.metrics import score, subgoals_reached
from .serving.client import ANSWER_SECONDS

CONDITIONS = "conditions"
"""The option of an episode that is one arm of a scene with events as conditions."""


@dataclass(frozen=True)
class EpisodeJob:
    """The policy sees `setup`, whose physics is that of the case. `paired` runs the scene without
    its events first: until the first one, both arms get the same answers."""

    case: Case
    policy: PolicyName
    clock: Clock
    code: str = ""
    setup: Setup = BLIND
    split: str = "unseen"
    answer_seconds: float = ANSWER_SECONDS
    benchmark: str = ""
    paired: bool = False

    def __str__(self) -> str:
        s = self.case.spec
        return f"{self.policy.label} in {s.task} on {s.embodiment}, level {s.level}, seed {s.seed}"

    @property
    def key(self) -> tuple[Any, ...]:
        case, seconds = self.case, self.answer_seconds
        options = [self.setup.given(), self.split, self.policy.process]
        if seconds != ANSWER_SECONDS:
            options.append(f"{seconds:g} s")
        if self.benchmark:
            options.append(f"benchmark {self.benchmark}")
        if self.paired:
            options.append("paired")
        if case.spec.arm:
            options.append(CONDITIONS)
        names = (self.code, self.policy.label, self.clock.name)
        return (*names, case.spec.to_json(), case.digest, options)


def start_of(robot: Embodiment, setup: Setup, words: str) -> Start:
    sizes = {c.name: (c.type.height, c.type.width) for c in setup_cameras(robot, setup)}
    usual = get_embodiment(robot.name, setup.layout)
    side = robot.sides[0]
    lift = round(float(robot.arms[side].base[2] - usual.arms[side].base[2]), 4)
    common = (words, robot.name, robot.vector_names, setup.fps)
    return Start(*common, tuple(sizes), policy_seed(words, robot.name), sizes, setup, lift)


def run_episode(job: EpisodeJob) -> dict[str, Any]:
    return play(job)[1]


def play(job: EpisodeJob) -> tuple[Trial, dict[str, Any]]:
    """A paired row has the arm without events in `control`. Raises as `play_arm`."""
    if not job.paired:
        return play_arm(job)
    tape, spec = list[Answer](), replace(job.case.spec, arm=CONTROL)
    control, other = play_arm(replace(job, case=replace(job.case, spec=spec)), tape)
    trial, row = play_arm(job, tape)
    names = ("success", "route_completion", "manipulation_score", "ending", "periods")
    row["control"] = {name: other[name] for name in names}
    row["same_prefix"] = _same_prefix(control, trial)
    return trial, row


def _same_prefix(control: Trial, trial: Trial) -> bool:
    scripts = [arm.simulation.script for arm in (control, trial)]
    ends = [script.first.fired if script and script.first else np.inf for script in scripts]
    one, two = control.log(), trial.log()
    frames = int((one.times <= ends[1] + 1e-9).sum())
    kept = (one.poses, two.poses), (one.qpos, two.qpos)
    return (
        ends[0] == ends[1]
        and all(a[:frames].tobytes() == b[:frames].tobytes() for a, b in kept)
        and one.action[: frames - 1].tobytes() == two.action[: frames - 1].tobytes()
    )


def play_arm(job: EpisodeJob, tape: "list[Answer] | None" = None) -> tuple[Trial, dict[str, Any]]:
    """The trial and its row; only `seconds_spent` differs between runs. Raises PolicyError,
    Failure."""
    spec, spent = job.case.spec, _Spent()
    with spent("scene"):
        scene = job.case.scene(job.setup)
        trial = Trial(scene, job.clock.motion(job.case.target_motion), job.setup)
        eyes = Eyes(scene, job.setup) if job.setup.cameras else None
    same = start_of_trial(trial.simulation) == job.case.start
    fault = ""
    try:
        with spent("policy"):
            asked = AskedPolicy(job.policy, job.answer_seconds)
        try:
            _drive(job, trial, eyes, asked, tape, spent)
        except (ActionError, NoAnswer) as error:
            fault = str(error)
            trial.end(INVALID_ACTION if isinstance(error, ActionError) else NO_ANSWER)
        except PolicyError as error:
            raise PolicyError(f"policy {job.policy.label}: {error}") from error
    finally:
        if eyes:
            eyes.close()
    with spent("score"):
        result = asdict(score(trial))
    cell = {k: v for k, v in spec.values().items() if k not in ("slot", "slot_seed", "arm")}
    row = {
        "policy": job.policy.label,
        "probe": job.policy.probe,
        "process": job.policy.process,
        "clock": job.clock.name,
        "rules": job.setup.label,
        **cell,
        "category": scene.task.category,
        "ending": trial.ending,
        "fault": fault,
        **result,
        "penalties": list(result["penalties"]),
        "failed": list(result["failed"]),
        "periods": round(trial.time * trial.fps),
        "asked": asked.count,
        "inferences": asked.inferences,
        "same_start": same,
        "sees_truth": asked.sees_truth,
    }
    if scene.choices:
        row["choices"] = scene.choices
        if (after := scene.give_roles(trial.simulation.roles).choices) != scene.choices:
            row["choices_after"] = after
    if scene.task.subgoals:
        row["subgoals"] = subgoals_reached(scene.task, row["failed"])
    if job.benchmark:
        row["benchmark"] = job.benchmark
    if asked.unreachable is not None:
        row["unreachable"] = asked.unreachable
    if (script := trial.simulation.script) is not None:
        given = [event for event in script.events if not event.withheld]
        happened = sorted((e for e in given if e.phase), key=lambda event: event.fired)
        if spec.arm not in ("", CONTROL):
            row["condition"] = "+".join(event.drawn.name for event in given) or "none"
        row["event"] = "+".join(event.drawn.kind for event in happened) or "none"
        row["phase"] = happened[0].phase if happened else "none"
        row["events"] = [
            {"name": event.drawn.name, "time": event.fired, "phase": event.phase}
            for event in happened
        ]
    return trial, row | {"seconds_spent": dict(spent.seconds)}


Answer = tuple[Floats, float]  # A chunk (H,A), and the time (s) of its inference


def _drive(
    job: EpisodeJob,
    trial: Trial,
    eyes: Eyes | None,
    asked: AskedPolicy,
    tape: list[Answer] | None,
    spent: "_Spent",
) -> None:
    """The arm without events fills the `tape` for the other. Raises as `AskedPolicy`."""
    script = trial.simulation.script
    records = job.case.spec.arm == CONTROL
    words = instruction_of(trial.scene, job.split)
    with spent("policy"):
        asked.begin(start_of(trial.scene.embodiment, job.setup, words), trial, job.case)
    if job.clock.join is not None and attribute(asked.policy, "scripted"):
        raise PolicyError(f"{job.clock.name} cannot overlap its chunks: use latency:...")

    def ask(committed: Floats) -> tuple[Floats, float]:
        with spent("render"):
            now = instruction_now(trial, job.split, words)
            observation = observe(trial, eyes, now, committed)
        before, number = spent.seconds["policy"], asked.inferences
        with spent("policy"):
            chunk = asked.answer(observation, trial.length)
        inferred = asked.inferences > number
        took = spent.seconds["policy"] - before
        delay = job.clock.delay(took) if inferred else 0.0
        if script is not None and inferred:
            delay += script.active("latency", trial.time)
        if tape is not None and records:
            tape.append((chunk.copy(), delay))
        elif tape and script is not None and script.first is None:
            chunk, delay = tape[asked.count - 1]
        return chunk, delay

    with spent("physics"):
        if job.clock.join is None:
            in_turn(trial, ask)
        else:
            drive_overlapped(trial, ask, job.clock.join)


class _Spent:
    """Wall seconds by purpose, without those inside it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._all = 0.0

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        began, before = time.perf_counter(), self._all
        try:
            yield
        finally:
            elapsed = time.perf_counter() - began
            self.seconds[name] += elapsed - (self._all - before)
            self._all = before + elapsed
