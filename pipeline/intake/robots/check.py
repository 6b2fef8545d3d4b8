"""`domino-data check-robot NAME`: can a robot do its work? A line and an image for each clause."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import sapien
from numpy.typing import NDArray

from pipeline.data.atomic import write_atomic
from pipeline.data.cameras import Camera, CameraType, look, project
from pipeline.data.names import NONE, SIDES
from pipeline.data.process.own_code import Finding
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.robots.place import COARSE, measure
from pipeline.planning.collision import CollisionWorld
from pipeline.planning.kinematics import chain_of, fk
from pipeline.poses import Pose, compose, transform
from pipeline.report.film_strip import encode
from pipeline.stages.attempt import Phases, attempt
from pipeline.stages.failure import Failure
from pipeline.world.cameras import cameras_of
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.objects.geometry import cylinder
from pipeline.world.physics.arms import add_arm, to_sapien
from pipeline.world.robots import RobotError, get_embodiment
from pipeline.world.robots.contract import (
    Embodiment,
    arm_poses,
    coupled_value,
    jaw_positions,
    jaw_value,
)
from pipeline.world.shapes import Material, Mesh

MOST_REACH = 0.5  # of the own half, below which most layouts are out of reach
CAN = 0.04  # m, diameter
GRIP_SECONDS, HZ = 1.5, 240
# rad/s or m/s, N m or N, kg: beyond these a file has placeholders
FASTEST, STRONGEST, HEAVIEST = 10.0, 1000.0, 200.0
MIRRORED = 0.08  # m between one tool and the mirror image of the other
SEEDS = 3  # of a task, until one is accepted at level 0
SIZE = CameraType(480, 360, 33.0)
PRESET = "raster-smooth"

type Image = NDArray[np.uint8]
type Part = tuple[Mesh, Material]

type Checked = tuple[Finding, Callable[[], Image] | None]
"""A finding, and the function that draws an image (H,W,3) of it, if any."""


def check_robot(name: str, tasks: Sequence[str], images: Path | None) -> Iterator[Finding]:
    """Check a robot, and try `tasks` on it at level 0; images go to the directory `images`, if
    any. Raises UnknownEmbodiment, and RobotError for one that is not sound."""
    robot = get_embodiment(name)
    if len(robot.sides) < len(SIDES):
        raise RobotError(f"{name}: is one arm of a robot: check the robot, without {NONE!r}")
    for check in (_limits, _masses, _pair, _home, _reach, _grip, _camera):
        finding, draw = check(robot)
        if images is not None and draw is not None:
            write_atomic(images / f"{name}-{finding.name}.png", encode(draw(), ".png"))
        yield finding
    if tasks:
        yield _tasks(robot, tasks)


def _limits(robot: Embodiment) -> Checked:
    odd = [
        f"{side} {joint.name} (velocity {joint.velocity:g}, effort {joint.effort:g})"
        for side, arm in robot.arms.items()
        for joint in arm.joints
        if joint.kind != "fixed" and (joint.velocity > FASTEST or joint.effort > STRONGEST)
    ]
    detail = "velocity and effort of every joint are plausible"
    if odd:
        detail = f"placeholders at {', '.join(odd[:4])}: give them under [limits]"
    return Finding("limits", not odd, detail), None


def _masses(robot: Embodiment) -> Checked:
    masses = {side: sum(link.mass for link in arm.links) for side, arm in robot.arms.items()}
    good = all(0.1 < mass < HEAVIEST for mass in masses.values())
    detail = ", ".join(f"{side} arm {mass:.2f} kg" for side, mass in masses.items())
    return Finding("mass", good, detail), None


def _pair(robot: Embodiment) -> Checked:
    left, right = (fk(chain_of(robot.arms[side]), robot.arms[side].home)[:3] for side in SIDES)
    apart = float(np.linalg.norm(left * (-1, 1, 1) - right))
    detail = f"at home the right tool is {100 * apart:.1f} cm from the mirror image of the left one"
    good = apart < MIRRORED or len({a.model for a in robot.arms.values()}) > 1
    return Finding("pair", good, detail), partial(_scene, robot)


def _home(robot: Embodiment) -> Checked:
    free = CollisionWorld(robot).with_objects(margin=0.0)
    left, right = (robot.arms[side].home for side in SIDES)
    jaws = (0.0, 0.5, 1.0)
    touching = [v for v in jaws if free.first_blocked(left, right, (v, v)) is not None]
    detail = "touches nothing with jaws closed, half open and open"
    if touching:
        detail = f"touches something with jaws at {touching}"
    return Finding("home", not touching, detail), None


def _reach(robot: Embodiment) -> Checked:
    arm = robot.arms["left"]
    if len(arm.arm_joints) < 6:
        text = f"{len(arm.arm_joints)} joints: the hand cannot take every orientation"
        return Finding("reach", False, text), None
    reach = measure(robot, COARSE)
    share = {f"{p:.0f}": float(v) for p, v in zip(COARSE.pitches, reach.own[0], strict=True)}
    detail = ", ".join(f"{100 * v:.0f} % at {p} degrees" for p, v in share.items())
    good = max(share.values()) >= MOST_REACH
    return Finding("reach", good, f"of its own half 5 cm above the table: {detail}"), None


def _grip(robot: Embodiment) -> Checked:
    """Closes the jaws on an upright can that nothing else holds: it must stay and stop the jaws."""
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
    width = float(np.clip(jaw_value(grip, built.jaw_positions()), 0, 1)) * grip.max_opening
    moved = float(np.linalg.norm(np.asarray(can.pose.p) - tcp[:3]))
    held = {body.entity.name for contact in scene.get_contacts() for body in contact.bodies}
    touching = [finger for finger in grip.fingers if f"left_{finger}" in held]
    good = moved < 0.03 and len(touching) == 2 and 0.4 * CAN < width < 1.8 * CAN
    text = (
        f"a can of {100 * CAN:.0f} cm stops the jaws at {100 * width:.1f} cm and moves by"
        f" {100 * moved:.1f} cm"
    )
    detail = f"{text}; touched by {len(touching)} of 2 fingers"

    def draw() -> Image:
        mesh = cylinder(CAN / 2, 0.06)
        body = (mesh.moved(np.array([0, 0, -0.03, 1, 0, 0, 0.0])), Material((0.8, 0.2, 0.15), 0.5))
        return np.hstack([_hand(robot, value, [body]) for value in (width / grip.max_opening, 1.0)])

    return Finding("grip", good, detail), draw


def _camera(robot: Embodiment) -> Checked:
    camera = cameras_of(robot)[1]
    arm = robot.arms["left"]
    seen = []
    for value in (0.0, 1.0):
        poses = arm_poses(arm, arm.home, value)
        eye = compose(poses[arm.hand], camera.pose)
        tool = compose(poses[arm.hand], arm.tcp)
        half = value * arm.gripper.max_opening / 2
        pads = transform(tool, np.array([[0, half, 0], [0, -half, 0]]))
        pixels, depth = project(camera.type, eye, pads)
        inside = (pixels >= 0) & (pixels < (camera.type.width, camera.type.height))
        seen.append(bool(inside.all() and (depth > 0).all()))
    detail = "the wrist camera sees both pads, open and closed"
    if not all(seen):
        detail = "the wrist camera misses a pad: move it under [camera]"
    return Finding("camera", all(seen), detail), None


def _tasks(robot: Embodiment, tasks: Sequence[str]) -> Finding:
    done = []
    for task in tasks:
        for seed in range(SEEDS):
            try:
                attempt(EpisodeSpec(task, robot.name, 0, 0.1, "clean", 0, seed), Recipe(), Phases())
            except Failure:
                continue
            done.append(task)
            break
    missing = [task for task in tasks if task not in done]
    detail = f"{len(done)} of {len(tasks)} at level 0"
    if missing:
        detail += f"; not: {', '.join(missing)}"
    return Finding("tasks", bool(done), detail)


def _scene(robot: Embodiment) -> Image:
    """The robot at home from across the table."""
    eye, aim = np.array([1.0, 0.95, 1.65]), np.array([0.0, -0.28, 0.9])
    return _draw(robot, 1.0, look(eye, aim - eye, np.cross([0, 0, 1], aim - eye)), (), aim)


def _hand(robot: Embodiment, value: float, body: Sequence[Part]) -> Image:
    """The left hand at home from the side, with a body in its tool frame unless it is closed."""
    arm = robot.arms["left"]
    tool = compose(arm_poses(arm, arm.home)[arm.hand], arm.tcp)
    eye = transform(tool, np.array([-0.05, 0.0, 0.45]))
    camera = look(eye, tool[:3] - eye, transform(tool, np.array([0, -1.0, 0])) - tool[:3])
    return _draw(robot, value, camera, body if value else (), tool)


def _draw(robot: Embodiment, value: float, eye: Pose, body: Sequence[Part], place: Pose) -> Image:
    """The robot at home with its jaws at `value`, and a body, if any, at its place."""
    looks, poses = {"body": tuple(body)}, {"body": place}
    for side, arm in robot.arms.items():
        looks |= {f"{side}_{link.name}": link.visual for link in arm.links}
        poses |= {f"{side}_{name}": p for name, p in arm_poses(arm, arm.home, value).items()}
    looks = {name: parts for name, parts in looks.items() if parts}
    at = {name: np.asarray(pose)[None] for name, pose in poses.items() if name in looks}
    cameras = [Camera("side", SIZE, None, eye)]
    with Renderer(looks, robot.furniture, cameras, CLEAN, PRESET) as renderer:
        return renderer.render(at)[0].rgb[0]
