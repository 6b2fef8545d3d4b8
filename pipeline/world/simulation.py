"""Physics only: a table, two arms, the bodies of a scene and one target that moves on its own until something touches it.

SAPIEN 3 on CPU PhysX. Fresh simulations that are given the same commands produce the same bytes. No renderer is ever opened here.
"""

import math
import tempfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Pose, compose, frame, inverse
from pipeline.world.body import TABLE_HALF, TABLE_TOP, Body
from pipeline.world.robots.contract import SIDES, Arm, Embodiment, jaw_positions, jaw_value
from pipeline.world.robots.urdf import arm_urdf
from pipeline.world.shapes import Collider
from pipeline.world.state_log import Event

PHYSICS_HZ = 240
_ROBOT_FRICTION = 1.2
_TABLE_FRICTION = 0.5
_JAW_STIFFNESS, _JAW_DAMPING = 1500.0, 60.0
_SLIDE_DAMPING = 60.0  # N s/m, what a drawer on wooden runners feels like
_STIFF = (1e4, 1e2)  # N m / rad and N m s / rad
_TOUCH_IMPULSE = 1e-7  # N s; SAPIEN lists near pairs with zero impulse before they touch
_X_TO_Z = sapien.Pose(q=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0])  # SAPIEN's capsules and cylinders lie along x


class Motion(Protocol):
    """What moves the target; `pipeline.motion.TargetMotion` is one."""

    def pose(self, t: ArrayLike) -> NDArray[np.float64]:
        """Poses (..., 7) at times t (...) in s."""
        ...

    def velocity(self, t: ArrayLike) -> NDArray[np.float64]:
        """Linear velocities (..., 3) m/s at times t (...)."""
        ...


def _pose(p: Pose) -> sapien.Pose:
    return sapien.Pose(p[:3], p[3:])


def _array(p: sapien.Pose) -> Pose:
    return np.array(p.__getstate__())  # the seven numbers x, y, z, w, x, y, z; several times faster than reading p and q


def _pieces(pieces: Sequence[Collider], material: Any, mass: float) -> list[Any]:
    """Collision shapes with densities that add up to `mass` (kg)."""
    density = mass / sum(c.weight * c.volume() for c in pieces)
    shapes = []
    for c in pieces:
        at = _pose(c.pose)
        if c.kind == "box":
            shape = sapien.physx.PhysxCollisionShapeBox(c.size, material)
        elif c.kind == "sphere":
            shape = sapien.physx.PhysxCollisionShapeSphere(c.size[0], material)
        elif c.kind == "convex":
            shape = sapien.physx.PhysxCollisionShapeConvexMesh(np.asarray(c.vertices, np.float32), (1.0, 1.0, 1.0), material)
        else:
            along_x = sapien.physx.PhysxCollisionShapeCylinder if c.kind == "cylinder" else sapien.physx.PhysxCollisionShapeCapsule
            shape, at = along_x(c.size[0], c.size[1], material), at * _X_TO_Z
        shape.set_local_pose(at)
        shape.set_density(density * c.weight)
        shapes.append(shape)
    return shapes


@lru_cache(maxsize=16)
def _arm_builder(arm: Arm, side: str) -> Any:
    """What SAPIEN makes of an arm's URDF, without a scene: parsing takes longer than 0.1 s of simulation."""
    loader = sapien.Scene([sapien.physx.PhysxCpuSystem()]).create_urdf_loader()
    loader.fix_root_link = True
    loader.set_material(_ROBOT_FRICTION, _ROBOT_FRICTION, 0.0)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(arm_urdf(arm))
        file.flush()
        builder = loader.parse(file.name)[0][0]
    for link in builder.link_builders:
        link.visual_records.clear()
        # the same id and ignore bit: no contacts inside one arm, contacts between the arms
        link.collision_groups = [1, 1, 1 << 29, 1 + SIDES.index(side)]
    return builder


class _Standing:
    """A motion that stands still at a pose."""

    def __init__(self, pose: Pose) -> None:
        self._pose = pose

    def pose(self, t: ArrayLike) -> NDArray[np.float64]:
        return np.broadcast_to(self._pose, (*np.shape(t), 7))

    def velocity(self, t: ArrayLike) -> NDArray[np.float64]:
        return np.zeros((*np.shape(t), 3))


class Simulation:
    """One scene. `step` advances 1/240 s under a command vector [left arm, left gripper, right arm, right gripper].

    The target is kinematic on `motion` until the first impulse with a robot link or with a free body; from then on it is a dynamic
    body that starts with the velocity it had. `events` then holds "meeting" and "release"; `touched_by` names what touched it,
    `touched_at` the step.
    """

    def __init__(self, embodiment: Embodiment, bodies: Sequence[Body], target: str, motion: Motion) -> None:
        self.embodiment, self.bodies, self.target, self.motion = embodiment, tuple(bodies), target, motion
        self.steps, self.settle_steps, self.events = 0, 0, list[Event]()
        self.released, self.touched_by, self.touched_at = False, "", -1
        self._upcoming: tuple[Any, ...] = ()
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        self._scene.set_timestep(1.0 / PHYSICS_HZ)
        table = self._add_table()
        self._entities = {b.name: self._add_body(b, pose) for b, pose in zip(self.bodies, self._first_poses(), strict=True)}
        self._rigid = {
            name: entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent) for name, entity in self._entities.items()
        }
        for body in self.bodies:
            self._add_slide(body)
        self._joints: dict[str, list[Any]] = {}
        self._order: dict[str, tuple[list[Any], list[Any]]] = {}
        self._robots = {side: self._add_arm(side, embodiment.arms[side]) for side in SIDES}
        self._rigid[target].set_kinematic(True)
        self._free = {b.name for b in self.bodies if not b.fixed and b.name != target}
        links = {side: self._robots[side].links for side in SIDES}
        self._link_names = tuple(f"{side}_{link.name}" for side in SIDES for link in links[side])
        self._posed = [*self._entities.values(), *(link.entity for side in SIDES for link in links[side])]
        self._hands = {side: next(x.entity for x in links[side] if x.name == embodiment.arms[side].hand) for side in SIDES}
        self.names = (*(b.name for b in self.bodies), *self._link_names, "table")
        physical = [*(e.components[0] for e in self._entities.values()), *(x for side in SIDES for x in links[side]), table]
        self._index = {component: i for i, component in enumerate(physical)}  # SAPIEN gives the same object every time
        riders = {b.name for b in self.bodies if b.inside == target}
        touchers = (self._free - riders).union(self._link_names)
        self._touchers = {component for component, name in zip(physical, self.names, strict=True) if name in touchers}
        self.joint_names = tuple(f"{side}_{j.name}" for side in SIDES for j in self._joints[side])
        self.command = self.home_vector()

    # --- building -------------------------------------------------------------------------------------------------------

    def _add_table(self) -> Any:
        """The table top's component."""
        material = sapien.physx.PhysxMaterial(_TABLE_FRICTION, _TABLE_FRICTION, 0.0)
        builder = self._scene.create_actor_builder()
        half = (*TABLE_HALF, 0.025)
        builder.add_box_collision(sapien.Pose([0, 0, TABLE_TOP - half[2]]), half, material)
        table = builder.build_static(name="table")
        floor = self._scene.create_actor_builder()
        floor.add_box_collision(sapien.Pose([0, 0, -0.05]), (3.0, 3.0, 0.05), material)
        floor.build_static(name="floor")
        return table.components[0]

    def _first_poses(self) -> list[Pose]:
        """Where the bodies begin: the target and what lies in it at the start of its motion, the others where they stand."""
        end = next(b.pose for b in self.bodies if b.name == self.target)
        start = np.asarray(self.motion.pose(np.zeros(())), float)
        riding = {self.target, *(b.name for b in self.bodies if b.inside == self.target)}
        return [compose(start, compose(inverse(end), b.pose)) if b.name in riding else b.pose for b in self.bodies]

    def _add_slide(self, body: Body) -> None:
        if body.slide is None:
            return
        parent = next(b for b in self.bodies if b.name == body.inside)
        x = np.asarray(body.slide.axis, float)
        y = np.array([0.0, 0.0, 1.0])
        along = frame((0, 0, 0), x, np.cross(np.cross(x, y), x) if abs(x[2]) < 0.9 else np.array([1.0, 0, 0]))
        drive = sapien.physx.PhysxDriveComponent(self._rigid[body.name])
        drive.set_parent(self._entities[parent.name].components[0])
        drive.set_pose_in_child(_pose(along))
        drive.set_pose_in_parent(_pose(compose(compose(inverse(parent.pose), body.pose), along)))
        drive.set_limit_x(body.slide.lower, body.slide.upper)
        drive.set_limit_y(0.0, 0.0)
        drive.set_limit_z(0.0, 0.0)
        drive.set_limit_twist(0.0, 0.0)
        drive.set_drive_property_swing(*_STIFF)  # SAPIEN's cone and pyramid limits do not hold the two other turns
        drive.set_drive_property_x(0.0, _SLIDE_DAMPING)
        self._entities[body.name].add_component(drive)

    def _add_body(self, body: Body, pose: Pose) -> sapien.Entity:
        shape = body.instance.shape()
        material = sapien.physx.PhysxMaterial(shape.friction, shape.friction, 0.0)
        component = sapien.physx.PhysxRigidStaticComponent() if body.fixed else sapien.physx.PhysxRigidDynamicComponent()
        for piece in _pieces(shape.collision, material, shape.mass):
            component.attach(piece)
        entity = sapien.Entity()
        entity.name = body.name
        entity.add_component(component)
        entity.set_pose(_pose(pose))
        self._scene.add_entity(entity)
        return entity

    def _add_arm(self, side: str, arm: Arm) -> sapien.physx.PhysxArticulation:
        builder = _arm_builder(arm, side)
        builder.set_scene(self._scene)
        robot = builder.build()
        robot.set_root_pose(_pose(arm.base))
        for link in robot.links:
            link.entity.name = f"{side}_{link.name}"
        active = list(robot.active_joints)
        by_name = {j.name: j for j in active}
        limits = {j.name: j for j in arm.joints}
        for name in arm.arm_joints:
            joint = by_name[name]
            joint.set_drive_properties(arm.stiffness, arm.damping, limits[name].effort, "force")
            joint.set_friction(0.0)
        for name in arm.gripper.joints:
            by_name[name].set_drive_properties(_JAW_STIFFNESS, _JAW_DAMPING, arm.gripper.force, "force")
            by_name[name].set_friction(0.0)
        self._joints[side] = active
        self._order[side] = ([by_name[n] for n in arm.arm_joints], [by_name[n] for n in arm.gripper.joints])
        qpos = dict(zip(arm.arm_joints, arm.home, strict=True)) | dict(
            zip(arm.gripper.joints, jaw_positions(arm.gripper, 1.0), strict=True)
        )
        robot.set_qpos(np.array([qpos[j.name] for j in active]))
        return robot

    def home_vector(self) -> NDArray[np.float64]:
        """Command vector with both arms at home and both grippers open."""
        return np.concatenate([[*self.embodiment.arms[side].home, 1.0] for side in SIDES])

    # --- stepping -------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Seconds since the episode began."""
        return self.steps / PHYSICS_HZ

    def step(self, command: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
        """Advance one physics step with drive targets `command` and `velocity` (vector layout; gripper entries 0-1 and 1/s)."""
        i = 0
        for side in SIDES:
            arm, robot = self.embodiment.arms[side], self._robots[side]
            joints, jaws = self._order[side]
            for joint in joints:
                joint.set_drive_target(command[i])
                joint.set_drive_velocity_target(velocity[i])
                i += 1
            closed, opened = arm.gripper.closed, arm.gripper.opened
            for k, jaw in enumerate(jaws):
                jaw.set_drive_target(closed[k] + command[i] * (opened[k] - closed[k]))
                jaw.set_drive_velocity_target(velocity[i] * (opened[k] - closed[k]))
            robot.set_qf(robot.compute_passive_force())
            i += 1
        if not self.released:
            self._rigid[self.target].set_kinematic_target(_pose(self._target_pose(self.steps + 1)))
        self._scene.step()
        self.steps += 1
        self.command = command
        if not self.released:
            self._watch()

    def _target_pose(self, step: int) -> Pose:
        """The motion's pose at a step, evaluated a second at a time because one array call costs as much as one pose."""
        if not self._upcoming or not self._upcoming[0] <= step < self._upcoming[0] + len(self._upcoming[1]):
            self._upcoming = (step, self.motion.pose((step + np.arange(PHYSICS_HZ)) / PHYSICS_HZ))
        return self._upcoming[1][step - self._upcoming[0]]

    def settle(self, max_steps: int = PHYSICS_HZ, quiet: float = 0.01) -> bool:
        """Let free bodies come to rest before the clock starts: at least 12 steps, until every speed is below `quiet` m/s.

        The target waits at the start of its motion, the arms at home. Returns whether rest was reached within `max_steps`.
        """
        command, still = self.home_vector(), np.zeros(len(self.command))
        motion, self.motion = self.motion, _Standing(self.motion.pose(np.zeros(())))
        for n in range(max_steps):
            self.step(command, still)
            if n >= 12 and all(self.speed(name) < quiet for name in self._free):
                break
        self.settle_steps, self.steps, self.motion, self._upcoming = self.steps, 0, motion, ()
        return not self.released and all(self.speed(name) < quiet for name in self._free)

    def _watch(self) -> None:
        target = self._rigid[self.target]
        for contact in self._scene.get_contacts():
            a, b = contact.bodies
            if a is not target and b is not target:
                continue
            other = b if a is target else a
            if other in self._touchers and any(np.dot(p.impulse, p.impulse) > _TOUCH_IMPULSE**2 for p in contact.points):
                self.events += [Event("meeting", self.time), Event("release", self.time)]
                self.touched_by, self.touched_at = self.names[self._index[other]], self.steps
                self._release()
                return

    def _release(self) -> None:
        body = self._rigid[self.target]
        body.set_kinematic(False)
        body.set_linear_velocity(self.motion.velocity(self.time).astype(np.float32))
        body.set_angular_velocity(np.zeros(3, np.float32))
        body.wake_up()
        self.released = True

    # --- reading --------------------------------------------------------------------------------------------------------

    def pose(self, name: str) -> Pose:
        """World pose (7,) of a body of the scene."""
        return _array(self._entities[name].pose)

    def velocity(self, name: str) -> NDArray[np.float64]:
        """Linear velocity (3,) m/s of a body's origin; that of the motion while the target is kinematic, zero for a fixed body."""
        if name == self.target and not self.released:
            return np.asarray(self.motion.velocity(self.time), float)
        body = self._rigid[name]
        return np.zeros(3) if body is None else np.asarray(body.linear_velocity, float)

    def speed(self, name: str) -> float:
        """Fastest motion of a body: linear speed in m/s plus 5 cm times its angular speed in rad/s."""
        body = self._rigid[name]
        if body is None:
            return 0.0
        return float(np.linalg.norm(self.velocity(name)) + 0.05 * np.linalg.norm(body.angular_velocity))

    def poses(self) -> NDArray[np.float64]:
        """World poses (B, 7) of all bodies, links and the table, in the order of `names`."""
        rows = [entity.pose.__getstate__() for entity in self._posed]  # see _array
        return np.array([*rows, (0.0, 0.0, TABLE_TOP, 1.0, 0.0, 0.0, 0.0)])

    def qpos(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Measured joint positions and velocities (J,), jaws included, in the order of `joint_names`."""
        robots = [self._robots[side] for side in SIDES]
        return np.concatenate([r.qpos for r in robots]).astype(float), np.concatenate([r.qvel for r in robots]).astype(float)

    def state_vector(self, qpos: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured vector (A,) in the layout of the command, from `qpos` (J,)."""
        by_name: Mapping[str, float] = dict(zip(self.joint_names, qpos, strict=True))
        out: list[float] = []
        for side in SIDES:
            arm = self.embodiment.arms[side]
            out += [by_name[f"{side}_{n}"] for n in arm.arm_joints]
            out.append(jaw_value(arm.gripper, np.array([by_name[f"{side}_{n}"] for n in arm.gripper.joints])))
        return np.array(out)

    def tcp(self, side: str) -> Pose:
        """Measured tcp pose (7,) of one arm."""
        return compose(_array(self._hands[side].pose), self.embodiment.arms[side].tcp)

    def contacts(self) -> list[tuple[int, int, float, NDArray[np.float64]]]:
        """Touching pairs now, the floor left out: indices a < b into `names`, impulse in N s, mean contact point (3,)."""
        # a pair of bodies may touch with many pieces, and SAPIEN lists them in no fixed order: the strongest is the pair's contact
        found: dict[tuple[int, int], tuple[float, tuple[float, ...]]] = {}
        for contact in self._scene.get_contacts():
            first, second = contact.bodies
            a, b = self._index.get(first), self._index.get(second)
            if a is None or b is None:
                continue
            points = contact.points
            pushes = np.array([p.impulse for p in points], float)
            strength = math.hypot(*pushes.sum(0)) if len(points) else 0.0
            pair = (min(a, b), max(a, b))
            if strength > _TOUCH_IMPULSE and strength >= found.get(pair, (0.0,))[0]:
                at = np.array([p.position for p in points], float)[pushes.any(1)].mean(0)
                found[pair] = max(found.get(pair, (0.0, ())), (strength, tuple(at.tolist())))
        return [(a, b, impulse, np.array(point)) for (a, b), (impulse, point) in sorted(found.items())]
