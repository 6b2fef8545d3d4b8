"""`domino-data check-task NAME`: does a task keep its contract?"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.data.process.own_code import Finding, catch_errors
from pipeline.data.recipe.model import Recipe, RecipeError
from pipeline.data.spec import EpisodeSpec
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Pose, quat_rotate
from pipeline.stages.attempt import Phases, Rollout, attempt
from pipeline.stages.failure import Failure
from pipeline.stages.reasons import reasons_of
from pipeline.stages.scene import Scene, build_scene
from pipeline.tasks import TASKS
from pipeline.tasks.language.check import check_templates, faults
from pipeline.tasks.language.sentences import instructions
from pipeline.tasks.outcome import failed

from .own_tasks import check_task as check_declared

SEEDS_PER_LEVEL = 12
LAYOUTS = 40
DEFAULT = Recipe()
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def check_task(
    name: str,
    embodiment: str = "aloha-agilex",
    levels: tuple[int, ...] = (0, 1, 2, 3),
    recipe: Recipe = DEFAULT,
    words: bool = True,
) -> list[Finding]:
    """Check one task on one robot. An error of the task's own code is a finding. Raises
    UnknownName and UnknownEmbodiment.
    """
    spec = EpisodeSpec(TASKS[name].name, embodiment, 0, 0.1, "clean", 0, 0)
    author = type(TASKS[name])
    try:
        check_declared(TASKS[name])
    except RecipeError as error:
        return [Finding("declared", False, str(error))]
    findings = [*catch_errors("layout", author, lambda: _layouts(spec))]
    rollouts = dict[int, Rollout]()
    for level in levels:
        check = partial(_level, replace(spec, level=level), recipe, rollouts)
        findings += catch_errors(f"level {level}", author, check)
    for rollout in [*rollouts.values()][:1]:
        findings += catch_errors("determinism", author, partial(_determinism, rollout, recipe))
    by_detail: dict[object, Finding] = {}
    for number, each in enumerate(findings):
        if not words and each.name.rpartition(" ")[2] in ("language", "words"):
            continue
        key = number if each.ok else each.detail
        name = f"{by_detail[key].name}, {each.name}" if key in by_detail else each.name
        by_detail[key] = replace(each, name=name)
    return list(by_detail.values())


def _level(spec: EpisodeSpec, recipe: Recipe, rollouts: dict[int, Rollout]) -> Iterator[Finding]:
    failures = list[Failure]()
    for seed in range(SEEDS_PER_LEVEL):
        try:
            rollouts[spec.level] = attempt(replace(spec, seed=seed), recipe, Phases())
            break
        except Failure as failure:
            failures.append(failure)
    rollout = rollouts.get(spec.level)
    detail = f"none of {SEEDS_PER_LEVEL} seeds was accepted"
    if rollout:
        detail = f"seed {rollout.scene.spec.seed}"
    yield Finding(f"level {spec.level}", rollout is not None, detail + _why(failures))
    yield from _episode(spec.level, rollout) if rollout else _find_unreached(spec.level, failures)


def _find_unreached(level: int, failures: Sequence[Failure]) -> Iterator[Finding]:
    usual = [(failure.stage, failure.reason) for failure in failures]
    for seed, failure in sorted(enumerate(failures), key=lambda each: -usual.count(usual[each[0]])):
        if unreached := find_unreached(failure):
            yield Finding(f"level {level} pose", False, f"seed {seed}: {unreached.text}")
            return


def _layouts(spec: EpisodeSpec) -> Iterator[Finding]:
    task, scenes, failures = TASKS[spec.task], list[Scene](), list[Failure]()
    for seed in range(LAYOUTS):
        try:
            scenes.append(build_scene(replace(spec, seed=seed)))
        except Failure as failure:
            failures.append(failure)
    detail = f"{len(scenes)} of {LAYOUTS} seeds could be laid out{_why(failures)}"
    yield Finding("layout", len(scenes) >= 0.9 * LAYOUTS, detail)
    outside = sum(not task.workspace.contains(s.bodies[task.target].pose) for s in scenes)
    detail = f"{outside} targets stand outside the task's workspace"
    yield Finding("workspace", outside == 0, detail)
    arms = {tuple(sorted(scene.arms.items())) for scene in scenes}
    both = len(arms) > 1 or any(len({side for _, side in roles}) == 2 for roles in arms)
    yield Finding("arms", both, f"roles seen: {[dict(roles) for roles in sorted(arms)]}")
    nothing = Finding("language", False, "no scene to say anything about")
    yield _language(scenes[-1]) if scenes else nothing


def _why(failures: Sequence[Failure]) -> str:
    return "".join(f"; {reason.describe()}" for reason in reasons_of(failures))


def _episode(level: int, rollout: Rollout) -> Iterator[Finding]:
    yield from _conditions(level, rollout)
    names = [e.name for e in rollout.replay.log.events]
    yield Finding(f"level {level} events", {"meeting", "success"} <= set(names), ", ".join(names))
    speed = rollout.motion.features().maximum_speed
    detail = f"target moves at up to {speed:.3f} m/s"
    yield Finding(f"level {level} motion", (speed == 0) == (level == 0), detail)
    wrong = _faulty_instruction(rollout.scene)
    yield Finding(f"level {level} words", wrong is None, wrong or "no fault in 100 instructions")


def _conditions(level: int, rollout: Rollout) -> Iterator[Finding]:
    scene, log = rollout.scene, rollout.replay.log
    outcome = scene.outcome(log)
    counts = range(1, len(log) + 1)
    per_frame = [scene.task.conditions(outcome.until(n), scene.arms) for n in counts]
    at_start = failed(per_frame[0])
    detail = f"fails at the start: {', '.join(at_start) or 'nothing'}"
    yield Finding(f"level {level} start", bool(at_start), detail)
    names, last = list(per_frame[-1]), per_frame[-1].items()
    changing = next((list(c) for c in per_frame if list(c) != names), None)
    malformed = [n for n, holds in last if not _NAME.fullmatch(n) or type(holds) is not bool]
    detail = ", ".join(names)
    if changing is not None:
        detail = f"the names change: {changing} and {names}"
    elif malformed:
        detail = f"not snake case or no bool: {', '.join(malformed)}"
    good = bool(names) and changing is None and not malformed
    yield Finding(f"level {level} conditions", good, detail)


def _language(scene: Scene) -> Finding:
    task = scene.task
    counts = f"{len(task.seen)} seen, {len(task.unseen)} unseen"
    asked = f"the contract asks for {task.least_seen} and {task.least_unseen}"
    try:
        wording = scene.wording()
        check_templates(
            wording.seen, wording.unseen, wording.objects, wording.arms, wording.choices
        )
    except ValueError as error:
        return Finding("language", False, str(error))
    enough = len(task.seen) >= task.least_seen and len(task.unseen) >= task.least_unseen
    return Finding("language", enough, f"{counts}; {asked}")


def _faulty_instruction(scene: Scene) -> str | None:
    try:
        wording = scene.wording()
        made = instructions(wording, scene.spec.rng("language"), 50)
    except ValueError as error:  # templates or phrases that cannot be used
        return str(error)
    for text in (*made["seen"], *made["unseen"]):
        if names := faults(text, wording):
            return f"{text!r}: {', '.join(names)}"
    return None


def _determinism(first: Rollout, recipe: Recipe) -> Iterator[Finding]:
    logs = [first.replay.log, attempt(first.scene.spec, recipe, Phases()).replay.log]
    keys = ("poses", "qpos", "action", "contacts")
    same = all(np.array_equal(*(getattr(log, key) for log in logs)) for key in keys)
    detail = "the same spec gives the same bytes" if same else "a second run differs"
    yield Finding("determinism", same, detail)


JUDGED = 12  # wanted poses, evenly spread over all, around which a reachable one is looked for
NEAR, FAR = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08), (0.1, 0.13, 0.16, 0.2, 0.25, 0.3)
DISTANCES = (*NEAR, *FAR, 0.4, 0.5, 0.6)
"""Metres from a wanted pose that are tried, nearest first."""


@dataclass(frozen=True, eq=False)
class Unreached:
    """A skill whose arm cannot reach the tcp pose (7,) `wanted`; `nearest` is the next free one."""

    skill: str
    side: str
    wanted: Pose
    nearest: Pose | None

    @property
    def text(self) -> str:
        sine = -quat_rotate(self.wanted[3:], np.array([1.0, 0, 0]))[2]
        down = np.degrees(np.arcsin(np.clip(sine, -1, 1)))
        most = 100 * DISTANCES[-1]
        found = f"no pose of that orientation within {most:.0f} cm is in reach and free"
        if self.nearest is not None:
            apart = float(np.linalg.norm(self.nearest[:3] - self.wanted[:3]))
            place = f"{_place(self.nearest)}, {100 * apart:.1f} cm away"
            found = f"the nearest pose in reach and free is {place}"
            if apart < 1e-9:
                found = "that pose is in reach and free, and no path leads there"
        where = f"{_place(self.wanted)}, {down:.0f} degrees below the horizontal"
        return f"{self.skill}: the {self.side} tcp is to be at {where}; {found}"


def find_unreached(failure: Failure) -> Unreached | None:
    """The pose of a failure; None if it is not about poses."""
    plan = failure.__cause__
    if not isinstance(plan, PlanFailure) or not isinstance(plan.arm, ArmPlanner):
        return None
    if plan.wanted is None or not len(plan.wanted):
        return None
    some = plan.wanted[np.unique(np.linspace(0, len(plan.wanted) - 1, JUDGED).round().astype(int))]
    wanted, there = nearest(plan.arm, some) or (some[0], None)
    return Unreached(plan.skill, plan.arm.side, wanted, there)


def nearest(arm: ArmPlanner, wanted: NDArray[np.float64]) -> tuple[Pose, Pose] | None:
    """One of the tcp poses `wanted` (N,7), and the nearest free one of its orientation, if any."""
    free = arm.checker()

    def first(poses: NDArray[np.float64]) -> int | None:
        q, ok = arm.solve(poses)
        return next((int(i) for i in np.flatnonzero(ok) if free(q[i])), None)

    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], float) - 1
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # from every wanted pose in every direction
    starts = np.repeat(wanted, len(directions), 0)
    ways = np.pad(np.tile(directions, (len(wanted), 1)), ((0, 0), (0, 4)))
    for before, distance in zip((0.0, *DISTANCES), DISTANCES, strict=False):
        if (i := first(starts + distance * ways)) is not None:
            nearer = starts[i] + np.linspace(before, distance, 11)[:, None] * ways[i]
            return starts[i], nearer[first(nearer) or 0]
    return None


def _place(tcp: Pose) -> str:
    return f"({', '.join(f'{value:.3f}' for value in tcp[:3])}) m"
