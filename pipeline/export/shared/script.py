"""What the expert did in every frame, from the runs of skills that act in the physics step after
it. Without one the skill is "wait", or "policy" if a policy acts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np

from pipeline.data.episode.state_log import SkillRun
from pipeline.data.names import SIDES

from .episodes import Facts

WAIT, POLICY = "wait", "policy"

WITH_BODY = {
    "close": "close {arms} on {body}",
    "face": "bring {body} and what the other arm holds to each other",
    "grasp": "grasp {body} with {arms}",
    "hand_over": "hand {body} over from {first} to {second}",
    "home": "bring {arms} home with {body}",
    "lift": "lift {body} with {arms}",
    "lift_clear": "lift {body} clear with {arms}",
    "open": "let go of {body} with {arms}",
    "pause": "hold {body} still with {arms}",
    "place": "place {body} with {arms}",
    "pour": "pour out {body} with {arms}",
    "press": "press {part}{body} with {arms}",
    "retreat": "draw {arms} back with {body}",
    "rock": "rock {body} with {arms}",
    "shake": "shake {body} with {arms}",
    "turn": "turn {body} with {arms}",
}
WITHOUT_BODY = {
    "close": "close the gripper of {arms}",
    "home": "bring {arms} home",
    "lift": "raise {arms}",
    "lift_clear": "raise {arms}",
    "open": "open the gripper of {arms}",
    "pause": "hold {arms} still",
    "press": "press down with {arms}",
    "retreat": "draw {arms} back",
    "turn": "turn the hand of {arms}",
}
"""Sentences by skill; a skill that has none moves or carries something."""


@dataclass(frozen=True)
class Script:
    """By frame: `subtask` is of the outermost runs, `skill` of the innermost, joined by "+"."""

    subtask: list[str]
    skill: list[str]
    stage: list[str]

    def changes(self) -> list[int]:
        if not any(self.subtask):
            return []
        return [t for t, text in enumerate(self.subtask) if t == 0 or text != self.subtask[t - 1]]


def script_of(facts: Facts) -> Script:
    """Texts are empty if the episode has no skills."""
    runs, frames = facts.log.skills, len(facts)
    if not runs:
        return Script([""] * frames, [""] * frames, [""] * frames)
    steps = np.rint(facts.log.times * facts.meta.physics_hz).astype(int)
    names = spoken_names(facts)
    met = max((run.end for run in runs if run.half == "meet"), default=0)
    texts, before = Script([], [], []), list[SkillRun]()
    acts = np.ones(frames, bool) if facts.log.intervention is None else facts.log.intervention
    for step, expert in zip(steps, acts, strict=True):
        now = [run for run in runs if run.start <= step < run.end]
        if now and now == before:
            for column in (texts.subtask, texts.skill, texts.stage):
                column.append(column[-1])
            continue
        before, idle = now, WAIT if expert else POLICY
        # a run that is listed before another one may enclose it
        inner = [a for i, a in enumerate(now) if not any(_within(b, a) for b in now[i + 1 :])]
        outer = [a for i, a in enumerate(now) if not any(_within(a, b) for b in now[:i])]
        skills = dict.fromkeys(run.skill for run in sorted(inner, key=_order))
        texts.skill.append("+".join(skills) or idle)
        texts.subtask.append(describe_runs(outer, names) or idle)
        texts.stage.append(now[0].half if now else ("meet" if step < met else "finish"))
    return texts


def rows_of(facts: Facts) -> list[dict[str, Any]]:
    """Runs with `start_frame`, whose action is their first, and `end_frame`."""
    every = facts.meta.physics_hz // facts.fps
    return [
        asdict(run) | {"start_frame": -(-run.start // every), "end_frame": -(-run.end // every)}
        for run in facts.log.skills
    ]


def spoken_names(facts: Facts) -> dict[str, str]:
    objects = facts.meta.objects
    counts = Counter(info.noun for info in objects.values())
    names = {n: o.noun if counts[o.noun] == 1 else o.description for n, o in objects.items()}
    return {name: f"the {text or name.replace('_', ' ')}" for name, text in names.items()}


def describe_runs(runs: Sequence[SkillRun], names: Mapping[str, str]) -> str:
    parts = list[tuple[int, str]]()
    rising = sorted(runs, key=lambda r: (r.skill, r.body, _order(r)))
    for _, group in groupby(rising, lambda r: (r.skill, r.body)):
        alike = list(group)
        parts.append((min(map(_order, alike)), _sentence(alike, names)))
    return " and ".join(sentence for _, sentence in sorted(parts))


def _sentence(runs: Sequence[SkillRun], names: Mapping[str, str]) -> str:
    run = runs[0]
    sides = [side for side in SIDES if any(side in run.arms for run in runs)]
    words = {
        "arms": "both arms" if len(sides) == 2 else f"the {sides[0]} arm",
        "first": f"the {run.arms[0]} arm",
        "second": f"the {run.arms[-1]} arm",
        "body": names.get(run.body, run.body),
        "part": f"the {run.part.replace('_', ' ')} of " if run.part not in ("", run.skill) else "",
    }
    if not run.body:
        return WITHOUT_BODY.get(run.skill, "move {arms}").format(**words)
    return WITH_BODY.get(run.skill, "carry {body} with {arms}").format(**words)


def _within(inner: SkillRun, outer: SkillRun) -> bool:
    in_time = outer.start <= inner.start and inner.end <= outer.end
    return in_time and set(inner.arms) <= set(outer.arms)


def _order(run: SkillRun) -> int:
    return SIDES.index(run.arms[0])
