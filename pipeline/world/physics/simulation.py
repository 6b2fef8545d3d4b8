"""Physics on CPU PhysX without a renderer: table, arms, bodies and one moving target. Equal
commands give equal bytes."""

from collections.abc import Collection, Sequence
from typing import Any, cast

import numpy as np
import sapien

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import Event
from pipeline.data.names import SIDES
from pipeline.motion.contract import Motion, TargetMotion
from pipeline.motion.planar import PlanarMotion
from pipeline.motion.scenery import AWAY
from pipeline.motion.wrapped import Change, changed, led_by, others_of
from pipeline.poses import (
    Floats,
    Pose,
    compose,
    inverse,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    rotation_vector,
)
from pipeline.world.robots.contract import Embodiment

from .arms import to_sapien
from .body import BORNE, Body
from .contacts import Contacts, ForceWatch, Overload
from .drive import AfterTouch, Drive, Hold, ImperfectDrives
from .events import PROP, EventScript
from .scene_building import PhysicsScene, as_pose, move_solid

_QUIET = 0.01  # m/s, below which a body counts as at rest before the clock starts
_START = np.zeros(())


class Simulation(PhysicsScene):
    """One scene. `step` advances 1/240 s under [left arm, left gripper, right arm, right gripper].

    The target is kinematic until its first impulse with a robot link or a free body, or `release`;
    `after_touch` decides what follows. It keeps its velocity. Bodies beside it are released with it
    or by their own touch. `events` holds those of `script`, "meeting", "release" and each first
    "clutter_touched" by anything but table and clutter. `touched_by`, `touched_at` (step): the
    meeting.
    """

    def __init__(
        self,
        embodiment: Embodiment,
        bodies: Sequence[Body],
        target: str,
        motion: Motion,
        *,
        after_touch: AfterTouch = "stop",
        clutter: Collection[str] = (),
        imperfect: ImperfectDrives | None = None,
        script: EventScript | None = None,
    ) -> None:
        self.target, self.motion, self._imperfect = target, motion, imperfect
        self._after_touch, self._drive, self.script = after_touch, None, script
        self._beside = dict(others_of(motion))
        props = script.props if script else ()
        end = next(b.pose for b in bodies if b.name == target)
        start = np.asarray(motion.pose(_START), float)
        poses = {
            b.name: compose(start, compose(inverse(end), b.pose))
            if target in (b.name, b.inside)
            else b.pose
            for b in bodies
        }
        for name, each in self._beside.items():
            poses[name] = np.asarray(each.pose(_START), float)
        super().__init__(embodiment, bodies, poses.values(), motion.scenery(), props)
        self.settle_steps, self.events = 0, list[Event]()
        self.released, self.touched_by, self.touched_at = False, "", -1
        self._upcoming_from, self._upcoming, self._waiting = 0, np.empty((0, 7)), False
        self._twists = np.empty((0, 6))
        waiting = {b.name for b in bodies if b.name.startswith(PROP)}
        for name in (target, *self._beside, *sorted(waiting)):
            self._dynamic(name).set_kinematic(True)
        self._borne = next(b.borne for b in bodies if b.name == target)
        self._free = {b.name for b in bodies if not b.fixed} - {target, *waiting}
        named = {component: self.names[i] for component, i in self._index.items()}
        self._forces = ForceWatch(embodiment, named)
        self._riders = {b.name for b in bodies if b.inside == target}
        self._untouched = {component: name for component, name in named.items() if name in clutter}
        self._harmless = {*self._untouched, self._table}
        self._watched_last, self.roles = cast(Contacts | None, None), dict[str, str]()
        self._take_roles()
        self.command = self.home_vector()

    def _take_roles(self) -> None:
        self._moved = self._dynamic(self.target)
        bodies = (self._rigid[name] for name in self._free - self._riders)
        self._touchers: set[Any] = {*bodies, *self._side_of}
        self._watched = self._still_watched()

    def can_take(self, name: str) -> bool:
        """Whether a body can take the role of the target, which no hand has touched."""
        return not (self.touched_by or self.released) and (
            name in self._beside or name.startswith(PROP)
        )

    def exchange(self, name: str) -> None:
        """Give a body the target's role, and the target its. A body that waited takes the target's
        place as well, others stay on their own motion. `roles` is the physical body by name."""
        target = self.target
        entities, rigid = self._entities, self._rigid
        entities[target], entities[name] = entities[name], entities[target]
        rigid[target], rigid[name] = rigid[name], rigid[target]
        self.roles = {target: name, name: target}
        if name.startswith(PROP):
            self._entities[target].set_pose(self._entities[name].pose)
            self._entities[name].set_pose(to_sapien(AWAY))
        else:
            self.motion = led_by(name, cast(TargetMotion, self.motion))
            others = others_of(self.motion)
            self._beside = {each: others[each] for each in self._beside}
            self._upcoming = self._upcoming[:0]
        self._take_roles()

    def _dynamic(self, name: str) -> sapien.physx.PhysxRigidDynamicComponent:
        body = self._rigid[name]
        if body is None:
            raise ValueError(f"{name!r} is fixed and cannot move")
        return body

    def step(self, command: Floats, velocity: Floats) -> None:
        """Advance one physics step; gripper entries are 0-1 and 1/s."""
        if self.script is not None and not self._waiting:
            self.script.before_step(self)
        for prop, entity in self._solid:
            move_solid(entity, np.asarray(prop.pose((self.steps + 1) / PHYSICS_HZ), float))
        first, (target, rate) = 0, (command, velocity)
        if self._imperfect is not None and not self._waiting:
            target, rate = self._imperfect.apply(command, velocity, self.time)
        if self.script is not None:
            target = self.script.commanded(target, self.time, self.grippers)
        for arm in self._arms.values():
            end = first + len(arm.joints) + 1
            arm.drive(target[first:end], rate[first:end])
            first = end
        if self._drive is not None:
            now, later = self.motion.twist(np.array([self.steps, self.steps + 1]) / PHYSICS_HZ)
            self._drive.push(self._target_pose(self.steps), now, later)
        elif not self.released:
            self._moved.set_kinematic_target(to_sapien(self._target_pose(self.steps + 1)))
        later = 0.0 if self._waiting else (self.steps + 1) / PHYSICS_HZ
        for name, motion in self._beside.items():
            pose = np.asarray(motion.pose(later), float)
            self._dynamic(name).set_kinematic_target(to_sapien(pose))
        if self._borne and self.time > self._stood + BORNE:
            self._moved.set_disable_gravity(False)
            self._moved.wake_up()
            self._borne = False
        joints = [robot.qpos for robot in self._robots]
        self._before = self._entities[self.target].pose, joints
        self._scene.step()
        self.steps += 1
        self.command, self._read = command, None
        if self._untouched or self._beside or not self.touched_by:
            self._watch()
        if self._drive is not None and self._drive.is_held(self._touching()):
            self.release()

    def _target_pose(self, step: int) -> Pose:
        """The motion's pose at a step; one array call for a second costs as much as one pose."""
        if not 0 <= step - self._upcoming_from < len(self._upcoming):
            self._upcoming_from, times = step, (step + np.arange(PHYSICS_HZ)) / PHYSICS_HZ
            self._upcoming, self._twists = self.motion.pose(times), self.motion.twist(times)
        return self._upcoming[step - self._upcoming_from]

    def change(self, change: Change) -> None:
        """Change the target's motion and scenery from now on."""
        self.motion = changed(cast(TargetMotion, self.motion), change)
        others = others_of(self.motion)
        self._beside = {name: others[name] for name in self._beside}
        self.scenery, self._upcoming = self.motion.scenery(), self._upcoming[:0]

    def shift(self, name: str, velocity: Floats) -> None:
        """Move a body by a velocity (3,) m/s in the next step, a fixed one at once."""
        body, entity = self._rigid[name], self._entities[name]
        if body is None:
            to = self.pose(name)
            to[:3] += velocity / PHYSICS_HZ
            entity.set_pose(to_sapien(to))
        else:
            body.set_linear_velocity(velocity.astype(np.float32))
            body.wake_up()

    def settle(self) -> bool:
        """Let free bodies rest before the clock starts, in 12 to 240 steps; returns whether they
        did."""
        command, still, motion = self.home_vector(), np.zeros(len(self.command)), self.motion
        self.motion, self._waiting = PlanarMotion.still(motion.pose(_START), 1.0), True
        at_rest = False
        for n in range(PHYSICS_HZ):
            self.step(command, still)
            at_rest = all(self.speed(name) < _QUIET for name in self._free)
            if n >= 12 and at_rest:
                break
        self.settle_steps, self.steps = self.steps, 0
        self.motion, self._upcoming, self._waiting = motion, self._upcoming[:0], False
        # the clock starts now
        self.events = [e for e in self.events if e.name != "clutter_touched"]
        return at_rest and not self.touched_by

    def _still_watched(self) -> set[Any]:
        """The components whose first touch counts."""
        return {*(self._rigid[name] for name in self._beside), *self._untouched, self._moved}

    def _watch(self) -> None:
        """Note the first touch of the target and of distractors; order in `names` decides ties."""
        touching, disturbed, contacts = list[int](), set[str](), self.touches
        if contacts is self._watched_last:
            return
        self._watched_last = contacts
        for k, (a, b) in enumerate(contacts.pairs):
            if a not in self._watched and b not in self._watched:
                continue
            if (a in self._harmless and b in self._harmless) or not contacts.pushes(k):
                continue
            for one, other in ((a, b), (b, a)):
                is_toucher = other in self._touchers
                if one is self._moved and not self.touched_by and is_toucher:
                    touching.append(self._index[other])
                if one not in self._watched:
                    continue
                name = self.names[self._index[one]]
                if name in self._beside and is_toucher:
                    self._let_go(name)
                if one in self._untouched and other not in self._harmless:
                    disturbed.add(name)
        for name in sorted(disturbed):
            self.events.append(Event("clutter_touched", self.time, name))
        if disturbed:
            left = {b: name for b, name in self._untouched.items() if name not in disturbed}
            self._untouched = left
            self._watched = self._still_watched()
        if touching:
            self.touched_by, self.touched_at = self.names[min(touching)], self.steps
            self.events.append(Event("meeting", self.time, self.touched_by))
            if self._after_touch == "stop":
                self.release()
            elif isinstance(self._after_touch, Hold):
                self._set_free(self.target, self.motion)
                self._moved.set_disable_gravity(self._borne)
                self._drive = Drive(self._moved, self._after_touch)

    def release(self) -> None:
        """End the target's own motion, if any."""
        if self.released:
            return
        self.events.append(Event("release", self.time))
        self.released, self._stood = True, self.time
        for name in tuple(self._beside):
            self._let_go(name)
        if self._drive is None:
            self._set_free(self.target, self.motion)
            self._moved.set_disable_gravity(self._borne)
        else:
            self._drive.end()
            self._drive = None

    def _let_go(self, name: str) -> None:
        self._set_free(name, self._beside.pop(name))
        self._watched = self._still_watched()

    def _set_free(self, name: str, motion: Motion) -> None:
        body = self._dynamic(name)
        body.set_kinematic(False)
        twist = motion.twist(self.time)
        arm = quat_rotate(self.pose(name)[3:], np.asarray(body.cmass_local_pose.p, float))
        centre = twist[:3] + np.cross(twist[3:], arm)
        body.set_linear_velocity(centre.astype(np.float32))  # PhysX's is the mass centre's
        body.set_angular_velocity(twist[3:].astype(np.float32))
        body.wake_up()

    def _touching(self) -> set[str]:
        """What touches the target."""
        pairs = (
            pair
            for k, pair in enumerate(self.touches.pairs)
            if self._moved in pair and self.touches.pushes(k)
        )
        return {self.names[self._index[b]] for pair in pairs for b in pair if b in self._touchers}

    def target_twist(self) -> Floats:
        """Linear (m/s) and angular velocity (rad/s) of the target's origin, (6,), world: of its
        motion, else of its last step. PhysX's own differ, for a held body by 1 rad/s."""
        if self._before is None or not (self.released or self._drive):
            known = self.steps - self._upcoming_from
            if 0 <= known < len(self._upcoming):
                return self._twists[known]
            return np.asarray(self.motion.twist(self.time), float)
        before, now = as_pose(self._before[0]), self.pose(self.target)
        turn = rotation_vector(quat_multiply(now[3:], quat_conjugate(before[3:])))
        return np.concatenate([now[:3] - before[:3], turn]) * PHYSICS_HZ

    def target_contacts(self, sides: Collection[str] = SIDES) -> dict[str, Floats]:
        """Points (N,3) at which links of an arm push the target now, by side, in a fixed order."""
        side_of = {link: side for link, side in self._side_of.items() if side in sides}
        return self.touches.points_on(self._moved, side_of)

    def overloads(self) -> list[Overload]:
        """Contacts of the robot in the last step that exceed `Forces`."""
        target = self.roles.get(self.target, self.target)
        rigid = target if self.steps == self.touched_at else ""
        return self._forces.overloads(self.touches, rigid)
