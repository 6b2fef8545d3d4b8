"""SAPIEN objects of a physics scene from specs, and the scene they make."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien.physx import PhysxMaterial, PhysxRigidBaseComponent, PhysxRigidDynamicComponent

from pipeline.data.clock import PHYSICS_HZ
from pipeline.motion.scenery import Prop
from pipeline.poses import Floats, Floats32, Pose, compose, frame, inverse
from pipeline.world.robots.contract import Embodiment
from pipeline.world.shapes import Collider

from .arms import add_arm, shape_of, to_sapien
from .body import TABLE_COLLISION, TABLE_TOP, Body, colliders_of
from .contacts import Contacts, Pair

CONTACT_OFFSET = 0.003
"""Distance (m) from a shape at which contacts begin to be looked for. Two shapes may close at
1.4 m/s without having met in a step; SAPIEN's 1 cm lists seven points of eight in vain."""
_TABLE_FRICTION = 0.5
_SLIDE_DAMPING = 60.0  # N s/m, what a drawer on wooden runners feels like
_STIFF = (1e4, 1e2)  # N m / rad and N m s / rad
# SAPIEN's capsules and cylinders lie along x
_X_TO_Z = sapien.Pose(q=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0])


def add_table(scene: sapien.Scene) -> PhysxRigidBaseComponent:
    """Returns the table top's component."""
    material = PhysxMaterial(_TABLE_FRICTION, _TABLE_FRICTION, 0.0)
    builder = scene.create_actor_builder()
    builder.add_box_collision(to_sapien(TABLE_COLLISION.pose), TABLE_COLLISION.size, material)
    table = builder.build_static(name="table")
    floor = scene.create_actor_builder()
    floor.add_box_collision(sapien.Pose([0, 0, -0.05]), (3.0, 3.0, 0.05), material)
    floor.build_static(name="floor")
    return physical(table)


def add_body(scene: sapien.Scene, body: Body, pose: Pose) -> sapien.Entity:
    """A body at a world pose (7,): static if fixed, else dynamic."""
    shape = body.instance.shape()
    component = (
        sapien.physx.PhysxRigidStaticComponent() if body.fixed else PhysxRigidDynamicComponent()
    )
    _attach(component, shape.collision, shape.friction, shape.mass)
    return _placed(scene, body.name, component, pose)


def add_solid(scene: sapien.Scene, prop: Prop) -> sapien.Entity:
    """A kinematic prop, moved by `move_solid`."""
    component = PhysxRigidDynamicComponent()
    _attach(component, colliders_of(prop), _TABLE_FRICTION, 1.0)
    component.set_kinematic(True)
    return _placed(scene, prop.name, component, prop.pose(0.0))


def _attach(
    component: PhysxRigidBaseComponent, pieces: Sequence[Collider], friction: float, mass: float
) -> None:
    """Attach shapes whose densities sum to `mass` (kg)."""
    material = PhysxMaterial(friction, friction, 0.0)
    density = mass / sum(c.weight * c.volume() for c in pieces)
    for c in pieces:
        shape = shape_of(c, to_sapien(c.pose), _X_TO_Z, material)
        shape.set_density(density * c.weight)
        component.attach(shape)


def _placed(
    scene: sapien.Scene, name: str, component: PhysxRigidBaseComponent, pose: Pose
) -> sapien.Entity:
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(component)
    entity.set_pose(to_sapien(pose))
    scene.add_entity(entity)
    return entity


def move_solid(entity: sapien.Entity, to: Pose) -> None:
    """Move a kinematic body in the next step; far moves are immediate and push nothing."""
    body = entity.find_component_by_type(PhysxRigidDynamicComponent)
    if body is None or np.linalg.norm(to[:3] - as_pose(entity.pose)[:3]) > 0.05:
        entity.set_pose(to_sapien(to))
    else:
        body.set_kinematic_target(to_sapien(to))


def add_slide(
    body: Body, parent: Body, entity: sapien.Entity, parent_entity: sapien.Entity
) -> None:
    """Let a body with a slide run in its parent."""
    assert body.slide is not None
    x = np.asarray(body.slide.axis, float)
    y = np.array([0.0, 0.0, 1.0])
    along = frame(
        (0, 0, 0), x, np.cross(np.cross(x, y), x) if abs(x[2]) < 0.9 else np.array([1.0, 0, 0])
    )
    drive = sapien.physx.PhysxDriveComponent(physical(entity))
    drive.set_parent(physical(parent_entity))
    drive.set_pose_in_child(to_sapien(along))
    drive.set_pose_in_parent(to_sapien(compose(compose(inverse(parent.pose), body.pose), along)))
    drive.set_limit_x(body.slide.lower, body.slide.upper)
    drive.set_limit_y(0.0, 0.0)
    drive.set_limit_z(0.0, 0.0)
    drive.set_limit_twist(0.0, 0.0)
    # SAPIEN's cone and pyramid limits do not hold the two other turns
    drive.set_drive_property_swing(*_STIFF)
    drive.set_drive_property_x(0.0, _SLIDE_DAMPING)
    entity.add_component(drive)


def physical(entity: sapien.Entity) -> PhysxRigidBaseComponent:
    """The colliding component; SAPIEN always gives the same object."""
    component = entity.components[0]
    if not isinstance(component, PhysxRigidBaseComponent):
        raise TypeError(f"{entity.name} has no physics component")
    return component


def as_pose(p: sapien.Pose) -> Pose:
    """SAPIEN's pose as ours (7,); faster than reading p and q."""
    return np.array(p.__getstate__())


class PhysicsScene:
    """Table, bodies and arms of one scene, and their measurements. `scenery` stops when the target
    is released, `props` do not."""

    def __init__(
        self,
        embodiment: Embodiment,
        bodies: Sequence[Body],
        poses: Iterable[Pose],
        scenery: tuple[Prop, ...],
        props: tuple[Prop, ...] = (),
    ) -> None:
        self.embodiment, self.bodies = embodiment, tuple(bodies)
        self.scenery, self._props = scenery, props
        self.steps, self._stood = 0, math.inf
        self._read: Contacts | None = None
        self._last: Contacts | None = None
        self._before: tuple[sapien.Pose, list[Floats32]] | None = None
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        self._scene.set_timestep(1.0 / PHYSICS_HZ)
        self._table = add_table(self._scene)
        self._entities = {
            b.name: add_body(self._scene, b, pose)
            for b, pose in zip(self.bodies, poses, strict=True)
        }
        self._solid = [(prop, add_solid(self._scene, prop)) for prop in props if prop.solid]
        self._rigid = {
            name: entity.find_component_by_type(PhysxRigidDynamicComponent)
            for name, entity in self._entities.items()
        }
        by_name = {b.name: b for b in self.bodies}
        for b in self.bodies:
            if b.slide is not None:
                add_slide(b, by_name[b.inside], self._entities[b.name], self._entities[b.inside])
        arms = embodiment.arms
        self._arms = {side: add_arm(self._scene, side, arm) for side, arm in arms.items()}
        self._robots = [arm.robot for arm in self._arms.values()]
        links = [(side, link) for side, arm in self._arms.items() for link in arm.robot.links]
        self._link_names = tuple(f"{side}_{link.name}" for side, link in links)
        self._side_of: dict[Any, str] = {link: side for side, link in links}
        self._posed = [*self._entities.values(), *(link.entity for _, link in links)]
        self._hands = {
            side: next(x.entity for x in arm.robot.links if x.name == arms[side].hand)
            for side, arm in self._arms.items()
        }
        seen = (prop.name for prop in (*scenery, *props))
        self.names = (*by_name, *self._link_names, *seen, "table")
        solids = [*map(physical, self._entities.values()), *self._side_of]
        self._index: dict[Any, int] = {component: i for i, component in enumerate(solids)}
        self._index[self._table] = len(self.names) - 1
        near = (physical(entity) for _, entity in self._solid)
        for component in (*solids, *near, self._table):
            for shape in component.collision_shapes:
                shape.contact_offset = CONTACT_OFFSET
        self.joint_names = tuple(
            f"{side}_{j.name}" for side, arm in self._arms.items() for j in arm.active
        )
        # which joints the state vector is read from
        at = {name: i for i, name in enumerate(self.joint_names)}
        places = list[int]()
        self._jaws = list[tuple[int, NDArray[np.intp], Floats, Floats]]()
        for side, arm in arms.items():
            closed, opened = np.array(arm.gripper.closed), np.array(arm.gripper.opened)
            places += [at[f"{side}_{n}"] for n in arm.arm_joints]
            jaws = np.array([at[f"{side}_{n}"] for n in arm.gripper.joints])
            self._jaws.append((len(places), jaws, closed, opened - closed))
            places.append(0)
        self._vector_from = np.array(places)

    @property
    def grippers(self) -> tuple[int, ...]:
        """A command's gripper entries."""
        return tuple(place for place, *_ in self._jaws)

    def home_vector(self) -> Floats:
        """The command of home with open grippers."""
        return np.concatenate([[*arm.home, 1.0] for arm in self.embodiment.arms.values()])

    @property
    def time(self) -> float:
        """Seconds since the episode began."""
        return self.steps / PHYSICS_HZ

    def pose(self, name: str) -> Pose:
        """World pose (7,) of a body of the scene."""
        return as_pose(self._entities[name].pose)

    def speed(self, name: str) -> float:
        """The mass centre's speed (m/s) plus 5 cm times the angular speed (rad/s)."""
        body = self._rigid[name]
        if body is None:
            return 0.0
        turning = 0.05 * np.linalg.norm(body.angular_velocity)
        return float(np.linalg.norm(body.linear_velocity) + turning)

    def poses(self) -> Floats:
        """World poses (B, 7) in the order of `names`."""
        rows = [entity.pose.__getstate__() for entity in self._posed]  # see _array
        rows += [prop.pose(min(self.time, self._stood)) for prop in self.scenery]
        rows += [prop.pose(self.time) for prop in self._props]
        return np.array([*rows, (0.0, 0.0, TABLE_TOP, 1.0, 0.0, 0.0, 0.0)])

    def qpos(self) -> tuple[Floats, Floats]:
        """Joint positions and their velocities over the last step (J,), as in `joint_names`."""
        now = np.concatenate([robot.qpos for robot in self._robots]).astype(float)
        before = now if self._before is None else np.concatenate(self._before[1]).astype(float)
        return now, (now - before) * PHYSICS_HZ

    def state_vector(self, qpos: Floats) -> Floats:
        """Measured vector (A,) in command layout, from `qpos` (J,)."""
        out = qpos[self._vector_from]
        for place, joints, closed, travel in self._jaws:
            # numpy's mean costs twice its sum
            out[place] = ((qpos[joints] - closed) / travel).sum() / len(travel)
        return out

    def tcp(self, side: str) -> Pose:
        """Measured tcp pose (7,) of one arm."""
        return compose(as_pose(self._hands[side].pose), self.embodiment.arms[side].tcp)

    @property
    def touches(self) -> Contacts:
        """The contacts of the last step."""
        if self._read is None:
            found = self._scene.get_contacts()
            if self._last is None or not self._last.still_hold(found):
                self._last = Contacts(found, self._index, self._table)
            self._read = self._last
        return self._read

    def contacts(self) -> list[Pair]:
        """Touching pairs without the floor, in the order of `names`."""
        return self.touches.touching
