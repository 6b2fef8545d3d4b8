"""`domino-data check-task NAME`: does a task keep its contract?"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.data.process.own_code import Finding, catch_errors
from pipeline.data.recipe.model import Recipe, RecipeError
from pipeline.data.spec import EpisodeSpec
from pipeline.planning.failure import PlanFailure
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.failure import Failure
from pipeline.stages.reasons import reasons_of
from pipeline.stages.scene import Scene, build_scene
from pipeline.tasks import TASKS
from pipeline.tasks.language.check import check_templates
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
    """An error of the task's own code is a finding. Raises UnknownName, UnknownEmbodiment."""
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
        if not words and each.name == "language":
            continue
        key = number if each.ok else each.detail
        name = f"{by_detail[key].name}, {each.name}" if key in by_detail else each.name
        by_detail[key] = replace(each, name=name)
    return list(by_detail.values())


def _level(spec: EpisodeSpec, recipe: Recipe, rollouts: dict[int, Rollout]) -> Iterator[Finding]:
    failures = list[Failure]()
    for seed in range(SEEDS_PER_LEVEL):
        try:
            rollouts[spec.level] = attempt(replace(spec, seed=seed), recipe)
            break
        except Failure as failure:
            failures.append(failure)
    rollout = rollouts.get(spec.level)
    detail = f"none of {SEEDS_PER_LEVEL} seeds was accepted" + _why(failures)
    if rollout:
        detail = f"seed {rollout.scene.spec.seed}" + _why(failures)
    elif skills := Counter(c.skill for f in failures if isinstance(c := f.__cause__, PlanFailure)):
        detail += f"; most often in {skills.most_common(1)[0][0]}"
    yield Finding(f"level {spec.level}", rollout is not None, detail)
    if rollout:
        yield from _episode(spec.level, rollout)


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
        instructions(wording, scene.spec.rng("language"))
    except ValueError as error:  # templates or phrases that cannot be used
        return Finding("language", False, str(error))
    enough = len(task.seen) >= task.least_seen and len(task.unseen) >= task.least_unseen
    return Finding("language", enough, f"{counts}; {asked}")


def _determinism(first: Rollout, recipe: Recipe) -> Iterator[Finding]:
    logs = [first.replay.log, attempt(first.scene.spec, recipe).replay.log]
    keys = ("poses", "qpos", "action", "contacts")
    same = all(np.array_equal(*(getattr(log, key) for log in logs)) for key in keys)
    detail = "the same spec gives the same bytes" if same else "a second run differs"
    yield Finding("determinism", same, detail)
