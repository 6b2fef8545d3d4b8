"""What happened, read from a state log. A question answers False if it does not apply yet."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.episode.state_log import StateLog
from pipeline.data.setup.rules import STRICT, Rules
from pipeline.poses import (
    Floats,
    Pose,
    angle_between,
    compose,
    inverse,
    quat_about,
    quat_multiply,
    quat_rotate,
    transform,
)
from pipeline.world.physics.body import Body
from pipeline.world.robots.contract import Embodiment

OPEN, CLOSED = 0.8, 0.2  # shares of its opening from which a gripper counts as open, or closed


@dataclass(eq=False)
class Outcome:
    """A state log with names and frames of its scene, asked about its last frame by default.

    Strict rules measure the gripper and need two fingers to hold; domino rules take the commanded
    opening and one finger."""

    log: StateLog
    bodies: Mapping[str, Body]
    embodiment: Embodiment
    target: str
    rules: Rules = STRICT

    def until(self, frames: int) -> "Outcome":
        """The same episode cut after its first `frames` frames."""
        log, spin = self.log, self.log.target_angular_velocity
        rows = ("times", "poses", "qpos", "qvel", "state", "action", "tcp", "target_velocity")
        cut = replace(
            log,
            **{name: getattr(log, name)[:frames] for name in rows},
            target_angular_velocity=None if spin is None else spin[:frames],
            contacts=log.contacts[log.contacts["frame"] < frames],
            events=[e for e in log.events if e.time <= log.times[frames - 1] + 1e-9],
        )
        return replace(self, log=cut)

    def pose(self, name: str, frame: int = -1) -> Pose:
        """World pose (7,) of a body at a frame."""
        return self.log.pose(name)[frame]

    def frame(self, name: str, point: str, at: int = -1) -> Pose:
        """World pose (7,) of a named frame of a body."""
        return compose(self.pose(name, at), self.bodies[name].instance.frames()[point])

    def offset(self, a: Pose, b: Pose) -> Floats:
        """Position of pose a relative to b in world axes (3,), m."""
        return a[:3] - b[:3]

    def _began(self, name: str) -> int:
        """The first frame; for the target the last one before the meeting."""
        met = self.log.time_of("meeting") if name == self.target else None
        if met is None:
            return 0
        return max(0, int(np.searchsorted(self.log.times, met, side="left")) - 1)

    def rise(self, name: str) -> float:
        """How far (m) a body's origin is above where it began, a target above where it was met."""
        return float(self.pose(name)[2] - self.pose(name, self._began(name))[2])

    def highest_rise(self, name: str) -> float:
        """The largest rise (m) of a body over the episode, of a target since it was met."""
        z = self.log.pose(name)[self._began(name) :, 2]
        return float(z.max() - z[0])

    def travel(self, name: str) -> float:
        """How far (m) a body's origin is from where it began, a target from where it was met."""
        return float(np.linalg.norm(self.pose(name)[:3] - self.pose(name, self._began(name))[:3]))

    def lies_in(self, name: str, hollow: str) -> bool:
        """Whether a body's origin is inside a hollow body: below its rim, within its outline."""
        at = transform(inverse(self.pose(hollow)), self.pose(name)[:3])
        low, high = self.bodies[hollow].instance.shape().aabb()
        return bool(((at > low - 0.002) & (at < high)).all())

    def upright(self, name: str, tolerance: float = 0.26) -> bool:
        """Whether a body's z axis is within `tolerance` rad of the vertical."""
        return bool(quat_rotate(self.pose(name)[3:], [0, 0, 1.0])[2] > np.cos(tolerance))

    def crossed(self, name: str, point: str, line: str) -> bool:
        """Whether a named frame of a body was ever beyond a line of the motion's scenery, the way
        its x axis points. False without such a line."""
        if line not in self.log.bodies:
            return False
        at = compose(inverse(self.log.pose(line)), self._frame_path(name, point))
        return bool((at[:, 0] > 0).any())

    def _frame_path(self, name: str, point: str) -> Floats:
        return compose(self.log.pose(name), self.bodies[name].instance.frames()[point])

    def turned(self, name: str) -> float:
        """Angle (rad) between a body's first and last orientation, of a target since it was met."""
        return angle_between(self.pose(name)[3:], self.pose(name, self._began(name))[3:])

    def orientation_error(self, a: Pose, b: Pose, turns: int = 1) -> float:
        """Angle (rad) between two orientations, b being as good after every 1/`turns` of a turn
        about its z axis."""
        ways = (quat_about((0, 0, 1), 2 * np.pi * k / turns) for k in range(turns))
        return min(angle_between(a[3:], quat_multiply(b[3:], way)) for way in ways)

    def at_rest(self, name: str, speed: float = 0.03, point: str = "") -> bool:
        """Whether a body, or a named frame of it, moved slower than `speed` m/s over the last
        three frames: in the world, or relative to a target still on its motion."""
        poses = self._frame_path(name, point) if point else self.log.pose(name)
        p, t = poses[-4:, :3], self.log.times[-4:]
        if self.log.event("release") is None and name != self.target:
            p = p - self.log.pose(self.target)[-4:, :3]
        return len(p) == 4 and float(np.linalg.norm(p[-1] - p[0])) <= speed * float(t[-1] - t[0])

    def opening(self, side: str, frame: int = -1) -> float:
        """Normalised opening of a gripper at a frame, 0 closed to 1 open."""
        return float(self.log.state[frame, self.log.vector_names.index(f"{side}_gripper")])

    def commanded(self, side: str, frame: int = -1) -> float:
        """Normalised opening that was commanded over the interval that ends at a frame."""
        at = max(0, frame % len(self.log) - 1)
        return float(self.log.action[at, self.log.vector_names.index(f"{side}_gripper")])

    def _opening(self, side: str, frame: int = -1) -> float:
        return (self.commanded if self.rules.name == "domino" else self.opening)(side, frame)

    def gripper_open(self, side: str) -> bool:
        """Whether a gripper is open."""
        return self._opening(side) > OPEN

    def closes(self, side: str) -> bool:
        """Whether a gripper is commanded to be closed; the measured opening depends on what it
        holds."""
        return self.commanded(side) < CLOSED

    def grippers_open(self) -> bool:
        """Whether all grippers are open."""
        return all(self.gripper_open(side) for side in self.log.sides)

    def met_by(self) -> str:
        """The body or link that touched the target first, "" if none did."""
        meeting = self.log.event("meeting")
        return meeting.by if meeting else ""

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.log.bodies)}

    def fingers(self, side: str) -> tuple[str, ...]:
        """Names of the finger links of one arm."""
        return tuple(f"{side}_{f}" for f in self.embodiment.arms[side].gripper.fingers)

    def contacts(self, a: str, b: str, last: int | None = None) -> NDArray[np.void]:
        """Contact rows (state_log.CONTACT_DTYPE) between two bodies, over the episode or its last
        `last` frames."""
        i, j = sorted((self._index[a], self._index[b]))
        rows = self.log.contacts
        between = rows[(rows["a"] == i) & (rows["b"] == j)]
        return between if last is None else between[between["frame"] >= len(self.log) - last]

    def touching(self, a: str, b: str, last: int = 2) -> bool:
        """Whether two bodies touched in the last frames."""
        return len(self.contacts(a, b, last)) > 0

    def holds(self, side: str, name: str) -> bool:
        """Whether both fingers of an arm (one of them under domino rules) touch a body now."""
        touching = [self.touching(finger, name) for finger in self.fingers(side)]
        return any(touching) if self.rules.name == "domino" else all(touching)

    def handled(self, name: str) -> bool:
        """Whether any link of either arm touches a body now."""
        links = [n for n in self.log.bodies if n.startswith(("left_", "right_"))]
        return any(self.touching(link, name) for link in links)

    def seated(
        self, name: str, goal: Pose, limit: Mapping[str, float], turns: int = 1
    ) -> dict[str, bool]:
        """The conditions of a body whose base shall be at `goal` (7,), with their limits: "centred"
        ("plane", or "along_x" and "along_y", m), and where there is a limit "at_height" ("height",
        m), "aligned" ("angle", rad) and "upright" ("tilt", rad). After each of `turns` parts of a
        turn the body is as well aligned."""
        base = self.frame(name, "base")
        d = self.offset(base, goal)
        plane = [limit.get(axis, limit.get("plane", 0.0)) for axis in ("along_x", "along_y")]
        found = {"centred": within(d[:2], plane)}
        if "height" in limit:
            found["at_height"] = within(d[2], limit["height"])
        if "angle" in limit:
            found["aligned"] = self.orientation_error(base, goal, turns) < limit["angle"]
        if "tilt" in limit:
            found["upright"] = self.upright(name, limit["tilt"])
        return found

    def resting(self, name: str, support: str) -> dict[str, bool]:
        """The three conditions of a body that was set down: it touches `support`, it is at rest, no
        arm touches it."""
        return {
            f"on_{support}": self.touching(name, support),
            "at_rest": self.at_rest(name),
            "released": not self.handled(name),
        }

    def set_down(self, name: str, support: str) -> dict[str, bool]:
        """Those of `resting`, and that all grippers are open."""
        return self.resting(name, support) | {"grippers_open": self.grippers_open()}

    def first_held(self, name: str) -> int | None:
        """The first frame at which all fingers of one hand touched a body, None for never."""
        held = set[int]()
        for side in self.log.sides:
            frames = (self.contacts(link, name)["frame"].tolist() for link in self.fingers(side))
            held |= set[int].intersection(*map(set, frames))
        return min(held, default=None)

    def took(self, name: str) -> bool:
        """Whether a hand ever held a body."""
        return self.first_held(name) is not None

    def touched(self, side: str, name: str) -> bool:
        """Whether a finger of an arm ever touched a body."""
        return any(len(self.contacts(finger, name)) for finger in self.fingers(side))

    def press(
        self, side: str, name: str, point: str, limit: Mapping[str, float]
    ) -> dict[str, bool]:
        """The three conditions of a press: a finger of the arm touched the body, near the named
        frame (limit["plane"] m in x and y, limit["height"] m), with a closed gripper."""
        near = (limit["plane"], limit["plane"], limit["height"])
        frames = [
            int(row["frame"])
            for finger in self.fingers(side)
            for row in self.contacts(finger, name)
            if within(row["point"] - self.frame(name, point, int(row["frame"]))[:3], near)
        ]
        return {
            "touched": self.touched(side, name),
            "pressed": bool(frames),
            "closed_at_press": any(self._opening(side, frame) < CLOSED for frame in frames),
        }

    def swings(self, name: str, angle: float) -> int:
        """How many times a body's z axis swung from more than `angle` rad on one side of its mean
        tilt axis to the other."""
        tilt = quat_rotate(self.log.pose(name)[:, 3:], np.array([0, 0, 1.0]))[:, :2]
        axis = np.linalg.svd(tilt - tilt.mean(0), full_matrices=False)[2][0]
        return _swings(tilt @ axis, angle)

    def rocks(self, name: str, angle: float) -> int:
        """How many times a body's z axis went from more than `angle` rad above the horizontal to as
        far below it, or back."""
        return _swings(quat_rotate(self.log.pose(name)[:, 3:], np.array([0, 0, 1.0]))[:, 2], angle)


def within(values: ArrayLike, limits: ArrayLike) -> bool:
    """Whether every value is smaller in magnitude than its limit, or than the one limit."""
    return bool((np.abs(values) < np.asarray(limits)).all())


def failed(conditions: Mapping[str, bool]) -> tuple[str, ...]:
    """Names of the conditions that do not hold; () means success."""
    return tuple(name for name, holds in conditions.items() if not holds)


def _swings(sines: Floats, angle: float) -> int:
    sides = np.sign(sines[np.abs(sines) > np.sin(angle)])
    return int(np.count_nonzero(np.diff(sides)))
