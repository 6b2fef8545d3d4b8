"""What is ours and what is the original's of each task, as data: regions, conditions, numbers."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from pipeline.data.cameras import visible
from pipeline.data.episode.state_log import CONTACT_DTYPE, StateLog
from pipeline.data.setup.rules import Rules, RuleSet
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import quat_about, quat_rotate
from pipeline.stages.scene import FRAME_MARGIN, Scene, build_scene
from pipeline.tasks import TASKS, Draw, Placement
from pipeline.tasks.contract import Region
from pipeline.world.cameras import cameras_of
from pipeline.world.objects.contract import Family
from pipeline.world.objects.families.containers.tableware import Bowl, Cup
from pipeline.world.objects.families.goods.bottles import Can, PillBottle
from pipeline.world.physics.body import TABLE_TOP
from pipeline.world.robots import get_embodiment

HERE = Path(__file__).parent
DRAWS = 120
"""Layouts drawn to find the regions of a task."""

ALIKE = 0.006
"""Two ends of a region that differ by less (m or rad) count as the same."""

REVOLVED = (Bowl, Can, Cup, PillBottle)
"""Bodies of revolution, which stand upright: their yaw changes nothing but the print on them."""

SAME_SHAPE = 0.0005
"""A vertex of a turned body lies nearer (m) to one of the body as it was where the two look the
same."""

SEEN = 0.01
"""A target's region counts as cut by the image of the head camera where more than this (m) of an
end is not seen."""

Facts = Mapping[str, Any]


@dataclass(frozen=True)
class Extent:
    """Where a body may stand, over both sides of the table: x, y and least |x| (m), and how it is
    turned there.

    Yaw (rad) goes up to `yaw` to either side of each of `headings`, counted over the whole turn:
    two headings where the left and the right side of the table differ. After every 1/`turns` of a
    turn the body looks the same; 0: at every yaw (a body of revolution), so that yaws are left out
    when two are compared. `least` are the least distances (m) from other bodies, by name.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    yaw: float
    away: float
    headings: tuple[float, ...] = (0.0,)
    turns: int = 1
    least: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        x = f"±{self.x[1]:.2f}" if abs(sum(self.x)) < ALIKE and self.x[1] > 0 else span(self.x)
        far = (
            f", not within {self.away:.2f}"
            if self.away > ALIKE and self.x[0] < 0 < self.x[1]
            else ""
        )
        apart = "".join(f"; {distance:.2f} from {name}" for name, distance in self.least)
        return f"x {x}{far}; y {span(self.y)}; yaw {self._describe_yaw()}{apart}"

    def _describe_yaw(self) -> str:
        """The yaw as text: its range, and what it is about where that is not 0 alone."""
        about = " and ".join(f"{heading:.2f}" for heading in self.headings)
        if not self.yaw:
            return about if any(self.headings) else "0"
        return f"±{self.yaw:.2f}" + (
            f" about {about}" if any(self.headings) and self.yaw < np.pi - ALIKE else ""
        )

    def differs(self, other: "Extent") -> bool:
        """Whether any end is another one, the yaw has another range or other headings, or a least
        distance is another one."""
        ours, theirs = ((*e.x, *e.y, e.away) for e in (self, other))
        moved = bool((np.abs(np.subtract(ours, theirs)) > ALIKE).any())
        return moved or self.least != other.least or (self.turns > 0 and self._turns_differ(other))

    def _turns_differ(self, other: "Extent") -> bool:
        """Headings count relative to the first one: which way the original's meshes face at yaw 0
        is not known."""
        period = 2 * np.pi / self.turns
        yaws = [min(e.yaw, period / 2) for e in (self, other)]
        if abs(yaws[0] - yaws[1]) > ALIKE or len(self.headings) != len(other.headings):
            return True
        ours, theirs = (np.subtract(e.headings, e.headings[0]) for e in (self, other))
        return bool((np.abs(np.angle(np.exp(1j * (ours - theirs) * self.turns))) > ALIKE).any())


def span(ends: Iterable[float]) -> str:
    """Two ends as text, or one where they are the same."""
    low, high = ends
    low, high = low + 0.0, high + 0.0  # no "-0.00"
    return f"{low:.2f}" if high - low < 1e-6 else f"{low:.2f} to {high:.2f}"


@cache
def original() -> Facts:
    """The original's numbers by task."""
    return json.loads((HERE / "original_tasks.json").read_text())


@cache
def reasons() -> Mapping[str, str]:
    """Why the regions of a task differ, by task."""
    return json.loads((HERE / "fidelity_reasons.json").read_text())


@cache
def layouts(task: str, rules: RuleSet = "strict") -> list[list[Placement]]:
    """Layouts of a task before anything is placed."""
    draws = (
        Draw(np.random.default_rng([0, seed]), np.random.default_rng([1, seed]), Rules(rules))
        for seed in range(DRAWS)
    )
    return [list(TASKS[task].layout(draw)) for draw in draws]


def extents(task: str) -> dict[str, Extent]:
    """Where each body may stand, bodies inside others left out."""
    found: dict[str, Extent] = {}
    for name in dict.fromkeys(p.name for layout in layouts(task) for p in layout if not p.inside):
        placements = [p for layout in layouts(task) for p in layout if p.name == name]
        regions = [p.region for p in placements]
        x, y = (np.array([sorted(getattr(r, axis)) for r in regions]) for axis in ("x", "y"))
        away = min(
            max(r.away_from_centre, 0.0, *np.multiply((1, -1), sorted(r.x))) for r in regions
        )
        turns = min(
            symmetry(p.instance) for p in {type(p.instance): p for p in placements}.values()
        )
        yaw = max((r.yaw[1] - r.yaw[0]) / 2 for r in regions)
        least = tuple(sorted(placements[0].distances.items()))
        ends = (x.min(), x.max()), (y.min(), y.max())
        found[name] = Extent(*ends, yaw, float(away), _headings(regions, turns), turns, least)
    return found


def _headings(regions: Iterable[Region], turns: int) -> tuple[float, ...]:
    """The different middles of the yaw (rad, 0 to 2 pi), those that look the same taken as one."""
    middles = sorted({round(sum(r.yaw) / 2, 3) + 0.0 for r in regions}, key=abs)
    kept = list[float]()
    for middle in middles:
        if not any(
            abs(np.angle(np.exp(1j * (middle - other) * max(turns, 1)))) < ALIKE for other in kept
        ):
            kept.append(middle)
    return tuple(kept)


def symmetry(instance: Family) -> int:
    """After how many equal parts of a turn about z a body looks the same: 4, 2 or 1, from its
    vertices; 0 where after any."""
    if isinstance(instance, REVOLVED):
        return 0
    points = np.concatenate([mesh.vertices for mesh, _ in instance.shape().visual])
    tree = KDTree(points)
    for turns in (4, 2):
        turned = quat_rotate(quat_about((0, 0, 1), 2 * np.pi / turns), points)
        if tree.query(turned)[0].max() < SAME_SHAPE:
            return turns
    return 1


def visible_range(task: str) -> tuple[float, float] | None:
    """Least and greatest x (m) at which the head camera sees a target on the table, anywhere in its
    region's y.

    None if it sees the whole region."""
    region, head = extents(task)[TASKS[task].target], cameras_of(get_embodiment("aloha-agilex"))[0]
    x, y = np.meshgrid(np.linspace(*region.x, 141), np.linspace(*region.y, 41), indexing="ij")
    points = np.stack([x, y, np.full_like(x, TABLE_TOP)], -1)
    kept = x[visible(head.type, head.pose, points, FRAME_MARGIN).any(-1), 0]
    low, high = float(kept.min()), float(kept.max())
    return (low, high) if max(low - region.x[0], region.x[1] - high) > SEEN else None


def originals(task: str) -> dict[str, Extent]:
    """The same of the original's dynamic version, with the symmetry of our bodies."""
    regions = {
        name: body["region"]
        for name, body in original()[task]["bodies"].items()
        if "region" in body
    }
    return {
        name: Extent(
            tuple(r["x"]),
            tuple(r["y"]),
            r["yaw"],
            r["away"],
            tuple(r.get("headings", (0.0,))),
            extents(task)[name].turns,
            tuple(sorted(r.get("least", {}).items())),
        )
        for name, r in regions.items()
    }


def moved(task: str) -> tuple[str, ...]:
    """Bodies whose region is not the original's."""
    ours = extents(task)
    return tuple(name for name, region in originals(task).items() if ours[name].differs(region))


def conditions(task: str) -> tuple[list[str], list[str]]:
    """Names of the conditions that both sets of rules ask for, and of those that only strict rules
    do."""
    spec = EpisodeSpec(task, "aloha-agilex", 0, 0.0, "clean", 0, 0)
    strict, domino = (_names(build_scene(spec, rules)) for rules in (Rules(), Rules("domino")))
    return domino, [name for name in strict if name not in domino]


def _names(scene: Scene) -> list[str]:
    """Condition names, asked of two frames in which nothing happens."""
    links = [
        f"{side}_{f}" for side, arm in scene.embodiment.arms.items() for f in arm.gripper.fingers
    ]
    names, vector = (*scene.bodies, *links, "table"), scene.embodiment.vector_names
    poses = np.zeros((2, len(names), 7))
    poses[..., 3] = 1
    poses[:, : len(scene.bodies)] = [body.pose for body in scene.bodies.values()]
    log = StateLog(
        times=np.zeros(2),
        bodies=names,
        poses=poses,
        joints=(),
        qpos=np.zeros((2, 0)),
        qvel=np.zeros((2, 0)),
        vector_names=vector,
        state=np.zeros((2, len(vector))),
        action=np.zeros((2, len(vector))),
        tcp=np.zeros((2, 2, 7)),
        target_velocity=np.zeros((2, 3)),
        contacts=np.zeros(0, CONTACT_DTYPE),
    )
    return list(scene.conditions(log))
