"""Success, route completion, manipulation score (paper, section 3.2), and why an episode failed.
Distances are from the tool point (`tcp`; the original's is 12 cm behind it)."""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.episode.state_log import StateLog
from pipeline.evaluate.scenes.trial import FAULTS, OUT_OF_VIEW, SUCCESS, Trial
from pipeline.poses import Floats
from pipeline.stages.scene import held_by
from pipeline.tasks.contract import Task
from pipeline.tasks.outcome import failed
from pipeline.world.physics.drive import Hold

OUT_OF_BOUNDS, CLUTTER = 0.5, 0.8
"""Factors of the manipulation score; CLUTTER if something touched a distractor."""

NEAR_START, NEAR_END = 0.01, 0.05
"""m; an arm that began within NEAR_START has progress 1 if it ended within NEAR_END, else 0.5."""

LIFTED = 0.02  # m; a body that rose by this much and came down without success was dropped

REACTIVE_LAG, MISSED, DROPPED = "reactive_lag", "missed", "dropped"
BIMANUAL, UNFINISHED = "bimanual", "unfinished"
FAILURES = (OUT_OF_VIEW, REACTIVE_LAG, MISSED, DROPPED, BIMANUAL, UNFINISHED, *FAULTS)
"""No valid answer: invalid_action, no_answer. No touch: out_of_view, reactive_lag if the nearest
tool was behind the moving target, else missed. A touch: bimanual if one of two acting arms never
touched what is handled, dropped, else unfinished."""


@dataclass(frozen=True)
class EpisodeScore:
    """`route_completion` and `manipulation_score` are in 0-100. `failed` names the success
    conditions that do not hold at the end, `failure` is one of FAILURES or "". `meeting` is the
    time (s) of the first touch, `hold` how much later (s) something first held the target for two
    frames, `nearest` the smallest distance (m) of a tool from the target up to then, `jerk` the
    root mean square of the third derivative of the tool positions (m/s3)."""

    success: bool
    route_completion: float
    manipulation_score: float
    penalties: tuple[str, ...]
    failed: tuple[str, ...]
    failure: str
    meeting: float | None
    hold: float | None
    nearest: float
    jerk: float
    seconds: float


def progress(start: ArrayLike, end: ArrayLike, goal: ArrayLike) -> float:
    """How far a tool came to `goal` (3,): 1 - d_T / d_0 in [0, 1], of its last and first
    distance."""
    away = (np.asarray(p, float) - np.asarray(goal, float) for p in (start, end))
    d0, dt = (float(np.linalg.norm(p)) for p in away)
    if d0 < NEAR_START:
        return 1.0 if dt < NEAR_END else 0.5
    return float(np.clip(1.0 - dt / d0, 0.0, 1.0))


def subgoals_reached(task: Task, missing: Collection[str]) -> dict[str, bool]:
    return {name: not {*parts} & {*missing} for name, parts in task.subgoals.items()}


def route_completion(tools: Floats, goal: ArrayLike, success: bool) -> float:
    """RC in [0, 100] from tools (T,arms,3) and the target's end (3,)."""
    if success:
        return 100.0
    return 100.0 * max(progress(tools[0, i], tools[-1, i], goal) for i in range(tools.shape[1]))


def manipulation_score(rc: float, *, out_of_bounds: bool, clutter: bool) -> float:
    """MS: `rc` times 0.5 out of bounds, times 0.8 if distractors were touched: once as in the
    paper, where its code has it for each."""
    return rc * (OUT_OF_BOUNDS if out_of_bounds else 1.0) * (CLUTTER if clutter else 1.0)


def touched_distractors(log: StateLog) -> tuple[str, ...]:
    """The distractors that anything but the table and other distractors touched."""
    return tuple(event.by for event in log.events if event.name == "clutter_touched")


def jerk(positions: Floats, fps: float) -> float:
    """RMS (m/s3) of the third difference of positions (T,...,3); 0 for fewer than four."""
    if len(positions) < 4:
        return 0.0
    third = np.diff(positions, 3, axis=0) * fps**3
    return float(np.sqrt((third**2).sum(-1).mean()))


def score(trial: Trial) -> EpisodeScore:
    """After a fault of the policy both scores are 0."""
    scene, log = trial.scene.by_role(trial.log())
    success = trial.ending == SUCCESS
    tools = log.tcp[:, :, :3]
    goal = log.pose(scene.task.target)[-1, :3]
    missing = () if success else failed(trial.conditions())
    reached = subgoals_reached(scene.task, missing).values()
    rc = 100.0 * fmean(reached) if reached else route_completion(tools, goal, success)
    if trial.ending in FAULTS:
        rc = 0.0
    away = trial.ending == OUT_OF_VIEW or trial.left_workspace
    penalties = {"out_of_bounds": away, "clutter": bool(touched_distractors(log))}
    return EpisodeScore(
        success=success,
        route_completion=rc,
        manipulation_score=manipulation_score(rc, **penalties),
        penalties=tuple(name for name, applies in penalties.items() if applies),
        failed=missing,
        failure="" if success else failure_class(trial, log),
        meeting=log.time_of("meeting"),
        hold=time_to_hold(log, held_by(scene.task, scene.embodiment), scene.task.target),
        nearest=float(_distances(log, scene.task.target).min()),
        jerk=jerk(tools, trial.fps),
        seconds=float(log.times[-1]),
    )


def failure_class(trial: Trial, log: StateLog) -> str:
    scene = trial.scene.by_role(log)[0]
    if trial.ending in (OUT_OF_VIEW, *FAULTS):
        return trial.ending
    if log.time_of("meeting") is None:
        return REACTIVE_LAG if _behind(log, scene.task.target) else MISSED
    acting, handled = set(scene.arms.values()), {scene.task.manipulated, scene.task.target}
    touched = {side for side in acting if _handled(log, side, handled)}
    if len(acting) > 1 and touched != acting:
        return BIMANUAL
    height = log.pose(scene.task.manipulated)[:, 2]
    rose, fell = height.max() - height[0] > LIFTED, height.max() - height[-1] > LIFTED
    return DROPPED if rose and fell else UNFINISHED


def time_to_hold(log: StateLog, hold: Hold, target: str) -> float | None:
    """Seconds from the first touch to the first of two frames in a row with a hold."""
    met, at = log.time_of("meeting"), log.bodies.index(target)
    pairs = [(int(row["frame"]), int(row["a"]), int(row["b"])) for row in log.contacts]
    touching: dict[int, set[str]] = {}
    for frame, a, b in pairs:
        if at in (a, b):
            touching.setdefault(frame, set()).add(log.bodies[a + b - at])
    held = [frame for frame, names in sorted(touching.items()) if hold.holds(names)]
    first = next((one for one, two in pairwise(held) if two == one + 1), None)
    return None if met is None or first is None else max(0.0, float(log.times[first]) - met)


def _distances(log: StateLog, target: str) -> Floats:
    """(F,S) of tools from the target, up to the first touch."""
    met = log.time_of("meeting")
    frames = len(log) if met is None else int(np.searchsorted(log.times, met)) + 1
    return np.linalg.norm(log.tcp[:frames, :, :3] - log.pose(target)[:frames, None, :3], axis=-1)


def _behind(log: StateLog, target: str) -> bool:
    """In the plane, whether the nearest tool was more behind than beside it."""
    nearest = int(_distances(log, target).argmin())
    frame, side = divmod(nearest, len(log.sides))
    velocity = log.target_velocity[frame, :2]
    speed = float(np.linalg.norm(velocity))
    if speed < 0.005:  # m/s
        return False
    ahead = log.pose(target)[frame, :2] - log.tcp[frame, side, :2]
    along = float(ahead @ velocity) / speed
    return along > 0 and along**2 > 0.5 * float(ahead @ ahead)


def _handled(log: StateLog, side: str, names: Collection[str]) -> bool:
    links = {i for i, name in enumerate(log.bodies) if name.startswith(f"{side}_")}
    bodies = {log.bodies.index(name) for name in names}
    pairs = {(int(row["a"]), int(row["b"])) for row in log.contacts}
    return any((a in links and b in bodies) or (b in links and a in bodies) for a, b in pairs)
