"""What is ours and what is the original's of each task, as data: regions, conditions, numbers."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.cameras import visible
from pipeline.data.rules import Rules, RuleSet
from pipeline.data.spec import EpisodeSpec
from pipeline.data.state_log import CONTACT_DTYPE, StateLog
from pipeline.stages.scene import FRAME_MARGIN, Scene, build_scene
from pipeline.tasks import TASKS, Draw, Placement
from pipeline.world.body import TABLE_TOP
from pipeline.world.cameras import cameras_of
from pipeline.world.objects.families.bowl import Bowl
from pipeline.world.objects.families.can import Can
from pipeline.world.objects.families.cup import Cup
from pipeline.world.objects.families.pill_bottle import PillBottle
from pipeline.world.robots import get_embodiment

HERE = Path(__file__).parent
DRAWS = 120
"""Layouts drawn to find the regions of a task."""

ALIKE = 0.006
"""Two ends of a region that differ by less (m or rad) count as the same."""

REVOLVED = (Bowl, Can, Cup, PillBottle)
"""Bodies of revolution, which stand upright: their yaw changes nothing but the print on them."""

SEEN = 0.01
"""A target's region counts as cut by the image of the head camera where more than this (m) of an end is not seen."""

Facts = Mapping[str, Any]


@dataclass(frozen=True)
class Extent:
    """Where a body may stand, over both sides of the table: x, y and least |x| (m), yaw to either side of a quarter turn (rad);
    `round`: the body is one of revolution, whose yaw is left out when two are compared."""

    x: tuple[float, float]
    y: tuple[float, float]
    yaw: float
    away: float
    round: bool = False

    def __str__(self) -> str:
        x = f"±{self.x[1]:.2f}" if abs(sum(self.x)) < ALIKE and self.x[1] > 0 else span(self.x)
        far = f", not within {self.away:.2f}" if self.away > ALIKE and self.x[0] < 0 < self.x[1] else ""
        return f"x {x}{far}; y {span(self.y)}; yaw {f'±{self.yaw:.2f}' if self.yaw else '0'}"

    def differs(self, other: "Extent") -> bool:
        """Whether any end is another one, or the range of the yaw is, smaller or larger."""
        ours, theirs = ((*e.x, *e.y, e.away) for e in (self, other))
        return bool((np.abs(np.subtract(ours, theirs)) > ALIKE).any()) or (not self.round and abs(self.yaw - other.yaw) > ALIKE)


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
    draws = (Draw(np.random.default_rng([0, seed]), np.random.default_rng([1, seed]), Rules(rules)) for seed in range(DRAWS))
    return [list(TASKS[task].layout(draw)) for draw in draws]


def extents(task: str) -> dict[str, Extent]:
    """Where each body may stand, bodies inside others left out."""
    found: dict[str, Extent] = {}
    for name in dict.fromkeys(p.name for layout in layouts(task) for p in layout if not p.inside):
        regions = [p.region for layout in layouts(task) for p in layout if p.name == name]
        x, y = (np.array([sorted(getattr(r, axis)) for r in regions]) for axis in ("x", "y"))
        away = min(max(r.away_from_centre, 0.0, *np.multiply((1, -1), sorted(r.x))) for r in regions)
        yaw = max(_turn(r.yaw) for r in regions)
        revolved = all(isinstance(p.instance, REVOLVED) for layout in layouts(task) for p in layout if p.name == name)
        found[name] = Extent((x.min(), x.max()), (y.min(), y.max()), yaw, float(away), revolved)
    return found


def seen(task: str) -> tuple[float, float] | None:
    """Least and greatest x (m) at which a target on the table is seen by the head camera, anywhere in its region's y, where that
    cuts an end of the region off; None where it does not."""
    region, head = extents(task)[TASKS[task].target], cameras_of(get_embodiment("aloha-agilex"))[0]
    x, y = np.meshgrid(np.linspace(*region.x, 141), np.linspace(*region.y, 41), indexing="ij")
    points = np.stack([x, y, np.full_like(x, TABLE_TOP)], -1)
    kept = x[visible(head.type, head.pose, points, FRAME_MARGIN).any(-1), 0]
    low, high = float(kept.min()), float(kept.max())
    return (low, high) if max(low - region.x[0], region.x[1] - high) > SEEN else None


def _turn(yaw: tuple[float, float]) -> float:
    """How far a range of yaw goes from the quarter turn nearest to its middle."""
    quarter = round((yaw[0] + yaw[1]) / np.pi) * np.pi / 2
    return min(max(abs(end - quarter) for end in yaw), np.pi)


def originals(task: str) -> dict[str, Extent]:
    """The same of the original's dynamic version."""
    bodies = {name: body["region"] for name, body in original()[task]["bodies"].items() if "region" in body}
    return {name: Extent(tuple(r["x"]), tuple(r["y"]), r["yaw"], r["away"]) for name, r in bodies.items()}


def moved(task: str) -> tuple[str, ...]:
    """Bodies whose region is not the original's."""
    ours = extents(task)
    return tuple(name for name, region in originals(task).items() if ours[name].differs(region))


def conditions(task: str) -> tuple[list[str], list[str]]:
    """Names of the conditions that both sets of rules ask for, and of those that only strict rules do."""
    spec = EpisodeSpec(task, "aloha-agilex", 0, 0.0, "clean", 0, 0)
    strict, domino = (_names(build_scene(spec, rules)) for rules in (Rules(), Rules("domino")))
    return domino, [name for name in strict if name not in domino]


def _names(scene: Scene) -> list[str]:
    """Condition names, asked of two frames in which nothing happens."""
    links = [f"{side}_{f}" for side, arm in scene.embodiment.arms.items() for f in arm.gripper.fingers]
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
