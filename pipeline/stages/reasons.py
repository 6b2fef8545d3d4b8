"""Failed attempts by reason: how many, what exactly, which conditions did not hold, and what to
change first."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

_REACH = "move the body's region nearer to the arm, or allow other pitches, directions or turns"
_ROOM = "leave more room around it: a larger gap in the layout, another pitch, a higher standoff"

HINTS = {
    "layout": "the layout leaves too little room: enlarge its regions or make the gaps smaller",
    "unstable": "a body moves before the start: place it where it rests, farther from the target",
    "no_meeting": "nothing touches the target in `meet`: its last skill must",
    "early_meeting": "the target is touched too early: approach from higher up or another side",
    "no_success": "do these conditions hold in a still scene (--levels 0), with that tolerance?",
    "no_motion": "no motion fits: a smaller alpha, a quicker `meet`, or a larger workspace",
    "missed": "the target slides past: meet it at its middle, with the jaws across its path",
    "occluded": "the arm hides the target: approach from another side, or move the region",
    "clutter_touched": "a distractor stands in the way: the next seed draws others",
    "arms_collide": "keep the arms apart: one after the other, or regions farther from x = 0",
    "path_blocked": _ROOM,
    "path_detour": "the hand has no short way there: nearer goals, or more room between",
    "excess_force": "give what the detail names more room, or offer other grasps",
    "line_unreachable": "the straight motion leaves the arm's reach: make it shorter, or nearer",
    "pose_unreachable": _REACH,
    "handover_blocked": "both arms cannot hold it: offer more places, or the receiver other grasps",
    "facing_blocked": "both hands cannot bring these together: offer more poses of either body",
    "place_blocked": _ROOM,
    "place_unreachable": _REACH,
    "press_blocked": _ROOM,
    "press_unreachable": _REACH,
    "pour_blocked": _ROOM,
    "pour_unreachable": _REACH,
    "turn_unreachable": "turn by a smaller angle, or grasp it with the wrist at the other end",
    "track_unreachable": "the hand cannot follow: a smaller alpha, or a meeting nearer to the arm",
    "shake_unreachable": "lift it to where the wrist has room, or swing by a smaller angle",
    "rock_unreachable": "lift it to where the wrist has room, or rock by a smaller angle",
    "no_grasp": "nothing fits between the jaws: allow other grasps, or narrower objects",
    "grasp_unreachable": _REACH,
    "grasp_blocked": _ROOM,
    "empty_hand": "it slipped: grasp it more firmly, or nearer to its centre of mass",
    "time_parameterisation": "the path has no timing within the joint limits: make it shorter",
    "step_limit": "raise the task's `step_limit`, or make the script shorter",
    "worker_died": "see the memory of the machine; the next seed was tried",
    "worker_hung": "raise --slot-timeout if the machine is slow; the next seed was tried",
}

NO_MOTION_HINTS = {
    "end_outside": "the target's region reaches out of the `workspace`: make it smaller",
    "miss": "the drawn motions do not end in time: the meeting may be too early for this level",
    "jump": "the drawn motions change too abruptly: `jumps: drawn` allows any jump at level 3",
    "smooth": "the drawn motions do not change abruptly: the meeting may be too early for level 3",
    "speed": "most motions are faster than alpha: a later meeting gives slower ones",
    "end_speed": "most motions are too fast at the meeting: a later meeting gives slower ones",
    "workspace": "the path leaves the workspace: a smaller alpha, or a region nearer to the middle",
    "tail": "the target leaves the workspace after the meeting: a region farther from its border",
    "visibility": "the head camera would not see the path: a region nearer to its image's middle",
    "blocked": "bodies stand in the way: more room around the target, or an approach from above",
}

EXAMPLES = 6  # conditions named at most

if TYPE_CHECKING:  # it imports the simulator
    from pipeline.stages.failure import Failure


def refusals(details: Iterable[str]) -> Counter[str]:
    """How many motions each check refused, from the details of no_motion failures."""
    found = Counter[str]()
    for name, number in re.findall(r"\b([a-z_]+) (\d+)\b", "\n".join(details)):
        if name in NO_MOTION_HINTS:
            found[name] += int(number)
    return found


def hint(reason: str, details: Iterable[str] = ()) -> str:
    """What to change first; for no_motion by what refused most motions. "" for an unknown
    reason."""
    refused = refusals(details) if reason == "no_motion" else None
    return NO_MOTION_HINTS[refused.most_common(1)[0][0]] if refused else HINTS.get(reason, "")


@dataclass(frozen=True)
class Reason:
    """Attempts that failed in one stage for one reason: `detail` of most of them (of no_motion: the
    motions that each check refused), how many did not fulfil each condition, and a hint."""

    stage: str
    reason: str
    attempts: int
    detail: str
    conditions: Mapping[str, int]
    hint: str

    def describe(self) -> str:
        conditions = _counts([*self.conditions.items()][:EXAMPLES])
        exactly = f"not fulfilled: {conditions}" if conditions else self.detail
        line = f"{self.attempts} x {self.stage}: {self.reason}"
        return line + (f" ({exactly})" if exactly else "") + (f"; {self.hint}" if self.hint else "")


def _counts(counted: Iterable[tuple[str, int]]) -> str:
    return ", ".join(f"{name} {number}" for name, number in counted)


def reasons_of(failures: Iterable["Failure"]) -> list[Reason]:
    """As `reasons_in`, of some failures."""
    return reasons_in((each.stage, each.reason, each.detail, each.conditions) for each in failures)


def reasons_in(
    attempts: Iterable[tuple[str | None, str | None, str | None, Sequence[str]]],
) -> list[Reason]:
    """The failed among some attempts (stage, reason, detail, conditions that did not hold); the
    most frequent reason first."""
    details = defaultdict[tuple[str, str], list[str]](list)
    conditions = defaultdict[tuple[str, str], Counter[str]](Counter)
    for stage, reason, detail, failed in attempts:
        if reason:
            details[stage or "", reason].append(detail or "")
            conditions[stage or "", reason].update(failed)
    found = [_reason(*kind, texts, conditions[kind]) for kind, texts in details.items()]
    return sorted(found, key=lambda r: (-r.attempts, r.stage, r.reason))


def _reason(stage: str, reason: str, details: Sequence[str], conditions: Counter[str]) -> Reason:
    plain = [detail.removeprefix(f"{reason}: ") for detail in details]
    usual = Counter(filter(None, plain)).most_common(1)
    detail = usual[0][0] if usual else ""
    if refused := refusals(plain) if reason == "no_motion" else None:
        detail = f"motions refused: {_counts(refused.most_common())}"
    fix = hint(reason, plain)
    return Reason(stage, reason, len(details), detail, dict(conditions.most_common()), fix)
