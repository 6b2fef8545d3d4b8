"""What to change first, by reason of failure: one line for whoever writes a task or a recipe."""

import re
from collections import Counter
from collections.abc import Iterable

_REACH = (
    "move the body's region nearer to the arm, or widen the choice that the skill is given (pitch,"
    " directions, turns)"
)
_ROOM = (
    "leave more room around it: a larger gap in the layout, another pitch or direction, or a higher"
    " standoff"
)

HINTS = {
    "layout": (
        "the regions of the layout leave too little room: enlarge them or make the gaps smaller"
    ),
    "unstable": "a body moves before the start: place it where it rests, farther from the target",
    "no_meeting": "nothing touches the target in `meet`: its last skill must",
    "early_meeting": (
        "the target is touched before the last skill of `meet`: approach it from higher up or from"
        " another side"
    ),
    "no_success": (
        "compare `finish` with these conditions: does each hold in a still scene (--levels 0), with"
        " that tolerance?"
    ),
    "no_motion": "no motion fits: a smaller alpha, a quicker `meet`, or a larger workspace",
    "missed": (
        "the target slides past what should touch it: meet it at its middle, with the jaws across"
        " its path"
    ),
    "occluded": (
        "the arm hides the target: approach from another side, or move the region to where the"
        " camera looks past the arm"
    ),
    "clutter_touched": "a distractor stands in the way: the next seed draws others",
    "arms_collide": (
        "keep the arms apart: one after the other instead of `together`, or regions farther from"
        " x = 0"
    ),
    "path_blocked": _ROOM,
    "path_detour": (
        "the hand has no short way there: offer goals nearer to where it comes from, or leave more"
        " room between"
    ),
    "excess_force": (
        "give what the detail names more room, or offer other grasps of what is carried"
    ),
    "line_unreachable": (
        "the straight motion leaves the arm's reach: make it shorter, or begin it nearer to the arm"
    ),
    "pose_unreachable": _REACH,
    "handover_blocked": (
        "no place is found where both arms can hold it: offer more places, or the receiver other"
        " grasps"
    ),
    "facing_blocked": (
        "no place is found where both hands bring what they hold to each other: offer more poses of"
        " either body"
    ),
    "place_blocked": _ROOM,
    "place_unreachable": _REACH,
    "press_blocked": _ROOM,
    "press_unreachable": _REACH,
    "pour_blocked": _ROOM,
    "pour_unreachable": _REACH,
    "turn_unreachable": (
        "turn by a smaller angle, or grasp it so that the wrist begins at the other end of its"
        " range"
    ),
    "track_unreachable": (
        "the hand cannot follow the target that far: a smaller alpha, or a meeting nearer to"
        " the arm"
    ),
    "shake_unreachable": "lift it to where the wrist has room, or swing by a smaller angle",
    "rock_unreachable": "lift it to where the wrist has room, or rock by a smaller angle",
    "no_grasp": (
        "no grasp of that kind fits between the jaws: allow other kinds, or objects that are"
        " narrower"
    ),
    "grasp_unreachable": _REACH,
    "grasp_blocked": _ROOM,
    "empty_hand": (
        "what should be in the hand was not held or slipped: grasp it more firmly, or nearer to its"
        " centre of mass"
    ),
    "time_parameterisation": (
        "the path has no timing within the joint limits: make the motion shorter"
    ),
    "step_limit": "raise the task's `step_limit`, or make the script shorter",
    "worker_died": (
        "a worker was lost on this seed: see the memory of the machine; the next seed was tried"
    ),
    "worker_hung": "raise --slot-timeout if the machine is slow; the next seed was tried",
}
"""Hint by reason code."""

NO_MOTION_HINTS = {
    "end_outside": (
        "the target's region reaches out of the task's `workspace`: make the region smaller or the"
        " workspace larger"
    ),
    "miss": "the drawn motions do not end in time: the meeting may be too early for this level",
    "jump": "the drawn motions change too abruptly: `jumps: drawn` allows any jump at level 3",
    "smooth": "the drawn motions do not change abruptly: the meeting may be too early for level 3",
    "speed": "most motions are faster than alpha: a later meeting gives slower ones",
    "end_speed": "most motions are too fast at the meeting: a later meeting gives slower ones",
    "workspace": (
        "the path does not fit the workspace: a smaller alpha, a quicker `meet`, or a region nearer"
        " to the middle"
    ),
    "tail": (
        "the target would leave the workspace right after the meeting: a region farther from its"
        " border"
    ),
    "visibility": (
        "the head camera would not see the path: a region nearer to the middle of its image"
    ),
    "blocked": (
        "robot or bodies stand in the way: more room between them and the target, or an approach"
        " from higher up"
    ),
}
"""Hint by what refused most motions (motion/planar/judge.py)."""


def refusals(details: Iterable[str]) -> Counter[str]:
    """How many motions each check refused, from the details of no_motion failures."""
    found = Counter[str]()
    for name, number in re.findall(r"\b([a-z_]+) (\d+)\b", "\n".join(details)):
        if name in NO_MOTION_HINTS:
            found[name] += int(number)
    return found


def hint(reason: str, details: Iterable[str] = ()) -> str:
    """What to change first; for no_motion by what refused most of the motions in `details`. "" for
    an unknown reason."""
    return hint_of(reason, refusals(details) if reason == "no_motion" else Counter())


def hint_of(reason: str, refused: Counter[str]) -> str:
    """As `hint`, from the motions refused by each check."""
    return NO_MOTION_HINTS[refused.most_common(1)[0][0]] if refused else HINTS.get(reason, "")
