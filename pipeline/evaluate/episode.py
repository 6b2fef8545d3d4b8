"""One evaluated episode: a case, a policy, a clock; its row of results."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

from pipeline.data.clock import DEFAULT_FPS, PHYSICS_HZ
from pipeline.data.errors import DominoError
from pipeline.evaluate.case import Case, start_hash
from pipeline.evaluate.clock import Clock
from pipeline.evaluate.contract import check_contract
from pipeline.evaluate.metrics import score
from pipeline.evaluate.policies import make_policy
from pipeline.evaluate.policy import Observation, Policy, PolicyError, PolicyName, SeesTruth, Start, chunk_of
from pipeline.evaluate.trial import Trial
from pipeline.evaluate.views import Eyes, instruction_of
from pipeline.stages.scene import build_scene
from pipeline.world.cameras import cameras_of


@dataclass(frozen=True)
class EpisodeJob:
    """What one evaluated episode is made from. `cameras` are what the policy sees, with `depth` their depth images too; `code` is
    the version of this program."""

    case: Case
    policy: PolicyName
    clock: Clock
    code: str = ""
    cameras: tuple[str, ...] = ()
    camera_type: str = "D435"
    split: str = "unseen"
    compounding: bool = False
    fps: int = DEFAULT_FPS
    depth: bool = False

    @property
    def key(self) -> tuple[Any, ...]:
        """What makes this episode another one than the others in a file of results."""
        options = (self.cameras, self.camera_type, self.split, self.compounding, self.fps, self.case.rules.label)
        if self.depth:
            options = (*options, "depth")
        return (self.code, self.policy.label, self.clock.name, self.case.spec.to_json(), self.case.digest, options)


@lru_cache(maxsize=1)
def _policy(name: PolicyName) -> Policy:
    """The policy of a name, made once in a process: loading one may take long."""
    return make_policy(name)


def _start(job: EpisodeJob, trial: Trial, words: str) -> Start:
    kinds = {camera.name: camera.type for camera in cameras_of(trial.scene.embodiment, job.camera_type)}
    sizes = {name: (kinds[name].height, kinds[name].width) for name in job.cameras}
    spec = job.case.spec
    return Start(words, spec.embodiment, trial.limits.names, job.fps, job.cameras, spec.seed, sizes)


def run_episode(job: EpisodeJob) -> dict[str, Any]:
    """The row of one episode; see `play`."""
    return play(job)[1]


def play(job: EpisodeJob) -> tuple[Trial, dict[str, Any]]:
    """The trial of one episode as it ended, and its row, JSON values only. `seconds_spent` are wall times and differ between runs,
    the rest does not.

    Raises PolicyError where the policy fails, ActionError for an answer that is no action, Failure where the scene does not rest.
    """
    spec, spent = job.case.spec, _Spent()
    with spent("scene"):
        scene = build_scene(spec, job.case.rules)
        trial = Trial(scene, job.clock.motion(job.case.target_motion), job.fps)
        eyes = Eyes(scene, job.cameras, job.camera_type) if job.cameras else None
    same = start_hash(trial.simulation.poses(), trial.simulation.qpos()[0]) == job.case.start
    words, policy, rng = instruction_of(scene, job.split), _policy(job.policy), spec.rng("evaluate/latency")
    try:
        with spent("policy"), _named(job.policy):
            start = _start(job, trial, words)
            check_contract(policy, start)
            policy.reset(start)
            if isinstance(policy, SeesTruth):
                policy.see(trial, job.case)
        asked = 0
        while not trial.ending:
            with spent("render"):
                images = eyes.look(trial.simulation, depth=job.depth) if eyes else {}
            simulation = trial.simulation
            observation = Observation(
                simulation.state_vector(simulation.qpos()[0]), words, trial.time, images, eyes.depth if eyes else {}
            )
            before = spent.seconds["policy"]
            with spent("policy"), _named(job.policy):
                chunk = chunk_of(policy.act(observation), trial.length)
            delay = job.clock.delay(asked, spent.seconds["policy"] - before, rng)
            asked += 1
            with spent("physics"):
                trial.hold(round(delay * PHYSICS_HZ))
                for action in chunk:
                    if trial.ending:
                        break
                    trial.advance(action)
    finally:
        if eyes:
            eyes.close()
    with spent("score"):
        result = asdict(score(trial, job.compounding))
    cell = {k: v for k, v in asdict(spec).items() if k not in ("slot", "slot_seed")}
    row = {
        "policy": job.policy.label,
        "clock": job.clock.name,
        "rules": job.case.rules.label,
        **cell,
        "category": scene.task.category,
        "ending": trial.ending,
    }
    row |= result | {"penalties": list(result["penalties"]), "failed": list(result["failed"])}
    row |= {"periods": round(trial.time * job.fps), "asked": asked, "same_start": same, "sees_truth": isinstance(policy, SeesTruth)}
    return trial, row | {"seconds_spent": dict(spent.seconds)}


class _Spent:
    """Wall seconds by what they were spent on."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - began


@contextmanager
def _named(policy: PolicyName) -> Iterator[None]:
    """Report in one line whatever a policy raises."""
    try:
        yield
    except DominoError:
        raise
    except Exception as error:
        raise PolicyError(f"policy {policy.label}: {type(error).__name__}: {error}") from error
