"""Table height, head camera and clutter of the randomized domain, each from its own stream."""

from typing import NamedTuple

import numpy as np

from pipeline.data.setup.rules import STRICT, Layout, Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Bools, Floats, Pose, inverse, transform, yawed
from pipeline.tasks import middle
from pipeline.tasks.contract import drawn_kind, family_of, name_of
from pipeline.world.objects.contract import Family
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP, Body
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import Embodiment, arm_poses
from pipeline.world.robots.pairs import looking, raised

TABLE_DROP = 0.03  # m by which the table is lower at most; the robot is higher instead
CAMERA_SHIFT, CAMERA_TURN = 0.006, np.radians(1.0)  # m, rad along and about each axis

CLUTTER_FAMILIES = (
    *("alarm_clock", "bell", "bread", "can", "coaster", "coffee_box", "fan", "mouse", "phone"),
    *("phone_stand", "pill_bottle", "playing_cards", "qr_sign", "remote", "rubiks_cube"),
    *("sauce_can", "scanner", "seal", "soap", "stapler", "tea_box", "toy_car", "wooden_block"),
)
"""Small families of few collision pieces that stay where they are put."""

CLUTTER_TRIES = 20
TASK_GAP = 0.08  # m kept from the bodies of the task, room for a hand
CLUTTER_GAP = 0.02  # m kept between distractors, and from the table's edge
ARM_GAP = 0.04  # m kept from the arms at home
HANDS, LOW = ((-0.33, -0.35), (0.33, 0.0)), 0.06
"""Corners (m) of where hands work; what stands there is at most `LOW` m high."""


def table_drop(spec: EpisodeSpec) -> float:
    """How much (m) lower the table is."""
    clean = spec.domain == "clean"
    return 0.0 if clean else float(spec.rng("table_height").uniform(0.0, TABLE_DROP))


class Stance(NamedTuple):
    """Table lowered by (m), head camera shifted (m) and turned (rad)."""

    drop: float
    shift: tuple[float, float, float]
    turn: tuple[float, float, float]


def stance_of(spec: EpisodeSpec) -> Stance | None:
    """None in the clean domain."""
    if spec.domain == "clean":
        return None
    shift, turn = spec.rng("head_camera").uniform(-1, 1, (2, 3)) * [[CAMERA_SHIFT], [CAMERA_TURN]]
    return Stance(table_drop(spec), tuple(shift.tolist()), tuple(turn.tolist()))


def embodiment_of(spec: EpisodeSpec, layout: Layout, stance: Stance | None) -> Embodiment:
    """The robot of a spec at its height, with its head camera."""
    embodiment = get_embodiment(spec.embodiment, layout)
    if stance is None:
        return embodiment
    return looking(raised(embodiment, stance.drop), stance.shift, stance.turn)


def clutter(
    spec: EpisodeSpec, bodies: dict[str, Body], embodiment: Embodiment, rules: Rules = STRICT
) -> dict[str, Body]:
    """Distractors by name, of other kinds than the task's `bodies`, apart from all, and occluding
    none from the head camera.
    """
    if spec.domain == "clean":
        return {}
    rng = spec.rng("clutter")
    families = [str(name) for name in rng.permutation(CLUTTER_FAMILIES)]
    wanted = int(rng.integers(rules.clutter[0], rules.clutter[1] + 1))
    used = {word for body in bodies.values() for word in _nouns(body.instance)}
    links = _link_boxes(embodiment)
    middles = np.array([middle(b.pose, b.instance) for b in bodies.values()])
    found: dict[str, Body] = {}
    for family in families:
        if len(found) == wanted:
            break
        instance = drawn_kind(family, rules, rng).draw(rng)
        if used & _nouns(instance):
            continue
        size = [[TABLE_HALF[0]], [TABLE_HALF[1]], [np.pi]]
        x, y, yaw = rng.uniform(-1, 1, (3, CLUTTER_TRIES)) * size
        for k in range(CLUTTER_TRIES):
            at = yawed((x[k], y[k], TABLE_TOP), yaw[k])
            body = Body(f"clutter_{len(found) + 1}", name_of(instance), instance, at)
            if (
                _free(body, bodies, found, links)
                and not occluded([body], embodiment.head_camera, middles).any()
            ):
                found[body.name] = body
                break
    return found


def occluded(blockers: list[Body], camera: Pose, points: Floats) -> Bools:
    """Which world points (...,3) a camera above the table cannot see for a body before them."""
    out = np.zeros(points.shape[:-1], bool)
    for body in blockers:
        shape = body.instance.shape()
        top = body.pose[2] + shape.aabb()[1, 2]
        rise = np.maximum(top - points[..., 2], 0.0) / (camera[2] - points[..., 2])
        # the part of the sight line that is no higher than the body
        ray = rise[..., None] * (camera[:2] - points[..., :2])
        to = body.pose[:2] - points[..., :2]
        along = np.clip((to * ray).sum(-1) / np.maximum((ray * ray).sum(-1), 1e-12), 0.0, 1.0)
        near = np.linalg.norm(to - along[..., None] * ray, axis=-1) < shape.footprint_radius()
        out |= near & (rise > 0)
    return out


def _nouns(instance: Family) -> set[str]:
    return {*family_of(instance).split("_"), *instance.words().noun.lower().split()}


def _free(body: Body, bodies: dict[str, Body], found: dict[str, Body], links: Floats) -> bool:
    shape, at = body.instance.shape(), body.pose[:2]
    radius, top = shape.footprint_radius(), body.pose[2] + shape.aabb()[1, 2]
    if (np.abs(at) + radius + CLUTTER_GAP > TABLE_HALF).any():
        return False
    if top > TABLE_TOP + LOW and _distance(at, np.array(HANDS)) < radius:
        return False
    others = [(o.pose[:2], o.instance.shape().footprint_radius()) for o in found.values()]
    if any(np.linalg.norm(at - p) < radius + other + CLUTTER_GAP for p, other in others):
        return False
    low = links[links[:, 0, 2] < top + ARM_GAP]
    if any(_distance(at, box[:, :2]) < radius + ARM_GAP for box in low):
        return False
    own = [
        (transform(inverse(b.pose), body.pose[:3])[:2], b.instance.shape().aabb()[:, :2])
        for b in bodies.values()
    ]
    return all(_distance(local, box) >= radius + TASK_GAP for local, box in own)


def _distance(point: Floats, box: Floats) -> float:
    """Distance (m) of a point (2,) from a rectangle (2,2), 0 inside."""
    return float(np.linalg.norm(np.maximum(np.maximum(box[0] - point, point - box[1]), 0.0)))


def _link_boxes(embodiment: Embodiment) -> Floats:
    """World boxes (L,2,3) around the collision pieces of the arms at home."""
    boxes = []
    for arm in embodiment.arms.values():
        at = arm_poses(arm, arm.home)
        for link in arm.links:
            for piece in link.collision:
                points = transform(at[link.name], piece.support_points())
                boxes.append((points.min(0), points.max(0)))
    return np.array(boxes)
