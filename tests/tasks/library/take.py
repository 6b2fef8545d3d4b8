"""State logs made by hand around the real scene of a task, and rows that say where a condition
turns over. No physics runs here.

A `Take` has twelve frames at 15 Hz: bodies stand where the scene has them, are somewhere in the air
at frame 4, and lie from frame 7 on where `put` and its relatives leave them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.data.episode.state_log import CONTACT_DTYPE, Event, StateLog
from pipeline.data.names import SIDES
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import compose, inverse, pose, quat_about, yawed
from pipeline.stages.scene import build_scene
from pipeline.tasks.outcome import Outcome, failed

FRAMES, PEAK, PUT = 12, 4, 7
SEED = 3
ARM = "left_link1"
OTHER = {"left": "right", "right": "left"}


class Take:
    """The final poses, contacts, openings and events of an episode that is being made up."""

    def __init__(self, task, rules, seed=SEED):
        self.scene = build_scene(
            EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 0, seed), Rules(rules)
        )
        self.rules, self.arms, self.bodies = rules, self.scene.arms, self.scene.bodies
        fingers = [
            f"{side}_{f}"
            for side in SIDES
            for f in self.scene.embodiment.arms[side].gripper.fingers
        ]
        self.names = (*self.bodies, *fingers, ARM, "table")
        self.poses = np.zeros((FRAMES, len(self.names), 7))
        self.poses[..., 3] = 1
        for name, body in self.bodies.items():
            self.poses[:, self.names.index(name)] = body.pose
        self.contacts = []
        self.measured = {side: np.ones(FRAMES) for side in SIDES}
        self.commanded = {side: np.ones(FRAMES) for side in SIDES}
        self.met_by = self.scene.task.manipulated

    # --- where things are
    # ------------------------------------------------------------------------------------------

    def path(self, name):
        """Poses (12,7) of a body, to be written to."""
        return self.poses[:, self.names.index(name)]

    def pose(self, name):
        return self.path(name)[-1].copy()

    def instance(self, name):
        return self.bodies[name].instance

    def local(self, name, point):
        return self.instance(name).frames()[point]

    def frame(self, name, point):
        return compose(self.pose(name), self.local(name, point))

    def put(self, name, where):
        """The pose (7,) of a body from frame 7 on."""
        self.path(name)[PUT:] = where

    def shift(self, name, by):
        self.path(name)[PUT:, :3] += by

    def seat(self, name, point, goal):
        """Body `name` with its frame `point` on `goal` (7,)."""
        self.put(name, compose(goal, inverse(self.local(name, point))))

    def turn(self, name, axis, angle, point="base"):
        """Turn a body about a world axis through one of its frames."""
        at, was = self.frame(name, point)[:3], self.pose(name)
        turned = compose(pose((0, 0, 0), quat_about(axis, angle)), pose(was[:3] - at, was[3:]))
        self.put(name, pose(turned[:3] + at, turned[3:]))

    def peak(self, name, rise=0.15):
        """A body was at frame 4 `rise` m above its highest pose."""
        path = self.path(name)
        path[PEAK, 2] = path[:, 2].max() + rise

    def begin(self, name, below, frames=slice(None)):
        """A body began `below` m under where it was highest in `frames` other than the first."""
        path = self.path(name)
        path[0, 2] = path[1:, 2][frames].max() - below

    def hurry(self, name, speed):
        """A body comes to its last pose at `speed` m/s along x over the last three intervals."""
        self.path(name)[-4, 0] -= speed * 3 / 15

    # --- who touches what
    # ------------------------------------------------------------------------------------------

    def fingers(self, side):
        return [n for n in self.names if n.startswith(f"{side}_") and n != ARM]

    def touch(self, a, b, frame=FRAMES - 1, point=(0, 0, 0)):
        self.contacts.append((frame, a, b, point))

    def apart(self, a, b):
        self.contacts = [row for row in self.contacts if {a, b} != set(row[1:3])]

    def hold(self, side, name):
        """A closed gripper with both fingers at a body."""
        for finger in self.fingers(side):
            self.touch(finger, name)
        self.command(side, 0.0)
        self.measured[side][:] = 0.4

    def drop(self, side, name, fingers):
        """So many fingers of an arm leave a body."""
        for finger in self.fingers(side)[: int(fingers)]:
            self.apart(finger, name)

    # --- grippers
    # ------------------------------------------------------------------------------------------

    def command(self, side, value):
        """The commanded opening, which counts from the interval that ends at the frame: the last
        entry is for what comes after."""
        self.commanded[side][:-1] = value

    def open(self, side, value):
        """The opening that the rules look at."""
        if self.rules == "domino":
            self.command(side, value)
        else:
            self.measured[side][:] = value

    def conditions(self):
        vector = self.scene.embodiment.vector_names
        state, action = np.zeros((2, FRAMES, len(vector)))
        for side in SIDES:
            state[:, vector.index(f"{side}_gripper")] = self.measured[side]
            action[:, vector.index(f"{side}_gripper")] = self.commanded[side]
        rows = [
            (f, *sorted((self.names.index(a), self.names.index(b))), 0.1, point, 1)
            for f, a, b, point in self.contacts
        ]
        log = StateLog(
            times=np.arange(FRAMES) / 15,
            bodies=self.names,
            poses=self.poses,
            joints=(),
            qpos=np.zeros((FRAMES, 0)),
            qvel=np.zeros((FRAMES, 0)),
            vector_names=vector,
            state=state,
            action=action,
            tcp=np.zeros((FRAMES, 2, 7)),
            target_velocity=np.zeros((FRAMES, 3)),
            contacts=np.array(rows, CONTACT_DTYPE),
            events=[Event("meeting", 0.05, self.met_by), Event("release", 0.05)],
        )
        scene = self.scene
        return scene.task.conditions(
            Outcome(log, self.bodies, scene.embodiment, scene.task.target, scene.rules), self.arms
        )


@dataclass(frozen=True)
class Row:
    """What a condition says when a quantity takes certain values: (value, whether it holds) under
    each set of rules.

    `domino` is None where domino rules do not ask for the condition. The conditions in `also` may
    fail with it; no other may.
    """

    condition: str
    change: Callable[[Take, float], None]
    strict: Sequence[tuple[float, bool]]
    domino: Sequence[tuple[float, bool]] | None
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class Spec:
    """A take in which everything holds, and where each condition turns over."""

    good: Callable[[Take], None]
    rows: Sequence[Row] = field(default=())


NEAR = 0.04
"""Values are tried this share inside and outside of a threshold."""


def sides(threshold, low, high, signs=(1,)):
    return [
        (s * threshold * f, holds)
        for s in signs
        for f, holds in ((1 - NEAR, low), (1 + NEAR, high))
    ]


def below(condition, change, strict, domino, also=(), signs=(1,)):
    """Holds for values under a threshold."""
    return Row(
        condition,
        change,
        sides(strict, True, False, signs),
        domino and sides(domino, True, False, signs),
        also,
    )


def above(condition, change, strict, domino, also=()):
    """Holds for values over a threshold."""
    return Row(
        condition, change, sides(strict, False, True), domino and sides(domino, False, True), also
    )


def positive(condition, change, asked=True, also=()):
    """Holds for values over zero; values are lengths in m."""
    cases = [(0.001, True), (-0.001, False)]
    return Row(condition, change, cases, cases if asked else None, also)


def fails(condition, change, asked=True, also=()):
    """Fails after a change."""
    cases = [(1, False)]
    return Row(condition, lambda t, q: change(t), cases, cases if asked else None, also)


def box(name, strict, domino, condition="centred", also=()):
    """Within a square of half side `strict`, `domino` around where the body is."""

    def corner(t, q):
        t.shift(name, (q, q, 0))

    return (
        below(condition, lambda t, q: t.shift(name, (q, 0, 0)), strict, domino, also, (1, -1)),
        below(condition, lambda t, q: t.shift(name, (0, q, 0)), strict, domino, also, (1, -1)),
        Row(
            condition,
            corner,
            [(strict * (1 - NEAR), True)],
            domino and [(domino * (1 - NEAR), True)],
            also,
        ),
    )


def circle(name, strict, domino, condition="centred", also=()):
    """Within a circle around where the body is."""
    return (
        below(
            condition,
            lambda t, q: t.shift(name, (0.6 * q, -0.8 * q, 0)),
            strict,
            domino,
            also,
            (1, -1),
        ),
    )


def height(name, strict, domino, also=()):
    return (
        below("at_height", lambda t, q: t.shift(name, (0, 0, q)), strict, domino, also, (1, -1)),
    )


def tilt(name, strict, domino, condition="upright", also=()):
    return (
        below(condition, lambda t, q: t.turn(name, (1, 0, 0), q), strict, domino, also, (1, -1)),
        below(condition, lambda t, q: t.turn(name, (0, 1, 0), q), strict, domino, also),
    )


def yaw(name, strict, domino, also=(), *, either_way=False):
    """Turned to where it shall face, `either_way` also the other way round."""
    other = [(np.pi, either_way), (np.pi / 2, False)]

    def turn(t, q):
        t.turn(name, (0, 0, 1), q)

    return (
        below("aligned", turn, strict, domino, also, (1, -1)),
        Row("aligned", turn, other, other, also),
    )


def lift(name, strict, domino, also=()):
    """It was once that much higher than where it began."""
    return (above("was_lifted", lambda t, q: t.begin(name, q), strict, domino, also),)


def rise(name, condition, strict, domino, also=()):
    """It is that much higher than where it began."""
    return (
        above(condition, lambda t, q: t.begin(name, q, slice(PUT, None)), strict, domino, also),
    )


def resting(name, support, asked=False):
    """Touching its support (which domino rules ask for where `asked`), at rest, let go."""
    return (
        fails(f"on_{support}", lambda t: t.apart(name, support), asked),
        below("at_rest", lambda t, q: t.hurry(name, q), 0.03, None),
        fails("released", lambda t: t.touch(ARM, name), asked=False),
    )


def both_open():
    return tuple(above("grippers_open", lambda t, q, s=s: t.open(s, q), 0.8, 0.8) for s in SIDES)


def opened(role, alone=True):
    """The gripper in that role is open; with `alone` it does not matter what the other one does."""
    free = Row(
        "gripper_open", lambda t, q: t.open(OTHER[t.arms[role]], q), [(0.5, True)], [(0.5, True)]
    )
    return (
        above("gripper_open", lambda t, q: t.open(t.arms[role], q), 0.8, 0.8),
        *([free] if alone else []),
    )


def held(condition, role, name):
    """Both fingers of the arm in that role touch it, which only we ask for: one does not hold it,
    nor does the other arm."""

    def taken_over(t):
        t.drop(t.arms[role], name, 2)
        for finger in t.fingers(OTHER[t.arms[role]]):
            t.touch(finger, name)

    return (
        Row(condition, lambda t, q: t.drop(t.arms[role], name, q), [(1, False), (2, False)], None),
        fails(condition, taken_over, asked=False),
    )


def met(name):
    """It touched the target first."""
    return (
        Row(
            f"met_by_{name}", lambda t, q: setattr(t, "met_by", "left_finger1"), [(1, False)], None
        ),
    )


def set_down(name, goal, point, *, at="base", turn=0.0):
    """A take in which a body stands on the named frame of another one, let go."""

    def good(t):
        t.seat(name, at, compose(t.frame(goal, point), yawed((0, 0, 0), turn)))
        t.peak(name)
        t.touch(name, goal)

    return good


def wrong(take):
    """The conditions that fail."""
    return set(failed(take.conditions()))
