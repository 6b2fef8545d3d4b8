"""`domino-data check-robot NAME`."""

from collections.abc import Iterator, Sequence

import numpy as np
import sapien

from pipeline.data.cameras import project
from pipeline.data.names import NONE, SIDES
from pipeline.data.process.own_code import Finding
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.planning.collision import CollisionWorld
from pipeline.planning.kinematics import chain_of, fk
from pipeline.poses import compose, transform
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.world.cameras import cameras_of
from pipeline.world.physics.arms import add_arm, to_sapien
from pipeline.world.robots import RobotError, get_embodiment
from pipeline.world.robots.contract import (
    Embodiment,
    arm_poses,
    coupled_value,
    jaw_positions,
    jaw_value,
)

from .place import COARSE, measure

MOST_REACH = 0.5  # of the own half, below which most layouts are out of reach
CAN = 0.04  # m, diameter
GRIP_SECONDS, HZ = 1.5, 240
# rad/s or m/s, N m or N, kg: beyond these a file has placeholders
FASTEST, STRONGEST, HEAVIEST = 10.0, 1000.0, 200.0
MIRRORED = 0.08  # m between one tool and the mirror image of the other
SEEDS = 3  # of a task, until one is accepted at level 0


def check_robot(name: str, tasks: Sequence[str]) -> Iterator[Finding]:
    """Check a robot, and `tasks` on it at level 0. Raises UnknownEmbodiment, RobotError."""
    robot = get_embodiment(name)
    if len(robot.sides) < len(SIDES):
        raise RobotError(f"{name}: is one arm of a robot: check the robot, without {NONE!r}")
    for check in (_limits, _masses, _pair, _home, _reach, _grip, _camera):
        yield check(robot)
    if tasks:
        yield _tasks(robot, tasks)


def _limits(robot: Embodiment) -> Finding:
    joints = [(side, joint) for side, arm in robot.arms.items() for joint in arm.joints]
    odd = [
        f"{side} {joint.name} (velocity {joint.velocity:g}, effort {joint.effort:g})"
        for side, joint in joints
        if joint.kind != "fixed" and (joint.velocity > FASTEST or joint.effort > STRONGEST)
    ]
    wrong = f"placeholders at {', '.join(odd[:4])}: give them under [limits]"
    good = "velocity and effort of every joint are plausible"
    return Finding("limits", not odd, wrong if odd else good)


def _masses(robot: Embodiment) -> Finding:
    masses = {side: sum(link.mass for link in arm.links) for side, arm in robot.arms.items()}
    good = all(0.1 < mass < HEAVIEST for mass in masses.values())
    detail = ", ".join(f"{side} arm {mass:.2f} kg" for side, mass in masses.items())
    return Finding("mass", good, detail)


def _pair(robot: Embodiment) -> Finding:
    left, right = (fk(chain_of(robot.arms[side]), robot.arms[side].home)[:3] for side in SIDES)
    apart = float(np.linalg.norm(left * (-1, 1, 1) - right))
    detail = f"at home the right tool is {100 * apart:.1f} cm from the mirror image of the left one"
    good = apart < MIRRORED or len({a.model for a in robot.arms.values()}) > 1
    return Finding("pair", good, detail)


def _home(robot: Embodiment) -> Finding:
    free = CollisionWorld(robot).with_objects(margin=0.0)
    left, right = (robot.arms[side].home for side in SIDES)
    jaws = (0.0, 0.5, 1.0)
    touching = [v for v in jaws if free.first_blocked(left, right, (v, v)) is not None]
    wrong = f"touches something with jaws at {touching}"
    good = "touches nothing with jaws closed, half open and open"
    return Finding("home", not touching, wrong if touching else good)


def _reach(robot: Embodiment) -> Finding:
    joints = len(robot.arms["left"].arm_joints)
    if joints < 6:
        return Finding("reach", False, f"{joints} joints: the hand cannot take every orientation")
    reach = measure(robot, COARSE)
    shares = zip(COARSE.pitches, reach.own[0], strict=True)
    detail = ", ".join(f"{100 * v:.0f} % at {p:.0f} degrees" for p, v in shares)
    good = bool(reach.own[0].max() >= MOST_REACH)
    return Finding("reach", good, f"of its own half 5 cm above the table: {detail}")


def _grip(robot: Embodiment) -> Finding:
    """Close the jaws on a free can: it must stay and stop the jaws."""
    arm = robot.arms["left"]
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / HZ)
    built = add_arm(scene, "left", arm)
    poses = arm_poses(arm, arm.home)
    tcp = compose(poses[arm.hand], arm.tcp)
    builder = scene.create_actor_builder()
    # a cylinder of SAPIEN lies along x: its axis is the tool's z
    upright = sapien.Pose(q=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0])
    builder.add_cylinder_collision(upright, CAN / 2, 0.03, density=400)
    can = builder.build(name="can")
    can.set_pose(to_sapien(tcp))
    body = can.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    assert body is not None
    body.set_disable_gravity(True)
    grip = arm.gripper
    for step in range(int(GRIP_SECONDS * HZ)):
        for joint, target in zip(built.joints, arm.home, strict=True):
            joint.set_drive_target(target)
        value = coupled_value(grip, built.jaw_positions(), max(0.0, 1 - step / (0.5 * HZ)))
        for joint, target in zip(built.jaws, jaw_positions(grip, value).tolist(), strict=True):
            joint.set_drive_target(target)
        built.robot.set_qf(built.robot.compute_passive_force())
        scene.step()
    width = float(np.clip(jaw_value(grip, built.jaw_positions()), 0, 1)) * grip.opening
    moved = float(np.linalg.norm(np.asarray(can.pose.p) - tcp[:3]))
    held = {body.entity.name for contact in scene.get_contacts() for body in contact.bodies}
    touching = [finger for finger in grip.fingers if f"left_{finger}" in held]
    good = moved < 0.03 and len(touching) == 2 and 0.4 * CAN < width < 1.8 * CAN
    stops = f"a can of {100 * CAN:.0f} cm stops the jaws at {100 * width:.1f} cm"
    moves = f"moves by {100 * moved:.1f} cm; touched by {len(touching)} of 2 fingers"
    return Finding("grip", good, f"{stops} and {moves}")


def _camera(robot: Embodiment) -> Finding:
    camera, arm, seen = cameras_of(robot)[1], robot.arms["left"], True
    for value in (0.0, 1.0):
        hand = arm_poses(arm, arm.home, value)[arm.hand]
        half = value * arm.gripper.opening / 2
        pads = transform(compose(hand, arm.tcp), np.array([[0, half, 0], [0, -half, 0]]))
        pixels, depth = project(camera.type, compose(hand, camera.pose), pads)
        inside = (pixels >= 0) & (pixels < (camera.type.width, camera.type.height))
        seen &= bool(inside.all() and (depth > 0).all())
    good = "the wrist camera sees both pads, open and closed"
    wrong = "the wrist camera misses a pad: move it under [camera]"
    return Finding("camera", seen, good if seen else wrong)


def _tasks(robot: Embodiment, tasks: Sequence[str]) -> Finding:
    def is_done(task: str, seed: int) -> bool:
        try:
            attempt(EpisodeSpec(task, robot.name, 0, 0.1, "clean", 0, seed), Recipe())
        except Failure:
            return False
        return True

    missing = [task for task in tasks if not any(is_done(task, seed) for seed in range(SEEDS))]
    done = len(tasks) - len(missing)
    detail = f"; not: {', '.join(missing)}" if missing else ""
    return Finding("tasks", done > 0, f"{done} of {len(tasks)} at level 0{detail}")
