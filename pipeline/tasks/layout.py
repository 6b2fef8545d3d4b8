"""Layouts, and the object families and arms that they need."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from pipeline.data.names import SIDES
from pipeline.motion.scenery import AWAY
from pipeline.planning.failure import PlanFailure
from pipeline.poses import Pose, compose, yawed
from pipeline.world.objects.contract import Family
from pipeline.world.physics.body import Body, apart, outline_of
from pipeline.world.physics.events import SWAPPED, in_roles

from .contract import Draw, Placement, Region, Task, UndeclaredFamily, family_of, name_of

TRIALS = 32  # layouts that are drawn to find the families of a task
NAMED = 8  # layouts that are drawn to find the names of its bodies
_LAYOUTS = 50  # layouts that are drawn until all bodies find room
_REPLACEMENTS = 300  # instances that are drawn for a swap
_POSES = 20  # poses that are drawn for a body before its layout is given up


class _Recording(Draw):
    def __init__(self, seed: int) -> None:
        super().__init__(np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1]))
        self.families = set[str]()

    def one_of(self, *families: str, **given: Any) -> Family:
        self.families.update(families)
        return super().one_of(*families, **given)


@cache
def families_of(task: Task) -> frozenset[str]:
    """Object families that a task depends on, before any scene is made: those that its class
    declares, or all that TRIALS of its layouts, from fixed seeds, choose from and place."""
    if task.families:
        return frozenset(task.families)
    families = set[str]()
    for seed in range(TRIALS):
        draw = _Recording(seed)
        placed = {name_of(placement.instance) for placement in task.layout(draw)}
        families |= placed | draw.families
    return frozenset(families)


def bodies_of(task: Task) -> set[str]:
    return {placement.name for placement in _placed(task)}


def goals_of(task: Task) -> set[str]:
    """Bodies that are neither target nor handled nor in another."""
    others = {placement.name for placement in _placed(task) if not placement.inside}
    return others - {task.target, task.manipulated}


def _placed(task: Task) -> Iterator[Placement]:
    for seed in range(NAMED):
        yield from task.layout(_Recording(seed))


def lay_out(
    task: Task,
    draw: Draw,
    in_view: Callable[[np.ndarray], bool] = lambda point: True,
    suits: Callable[[dict[str, Body]], bool] = lambda bodies: True,
) -> dict[str, Body]:
    """Bodies by name on the table with disjoint footprints, drawn again while `suits` refuses.
    `in_view` is asked for the middle (3,) of the target and `shown` bodies. Raises
    PlanFailure("layout")."""
    why = ""
    for _ in range(_LAYOUTS):
        bodies: dict[str, Body] = {}
        for p in task.layout(draw):
            if p.inside:
                pose = compose(bodies[p.inside].pose, _drawn_pose(p.region, draw.placement))
            else:
                others = [b for b in bodies.values() if not b.inside]
                is_seen = in_view if p.shown or p.name == task.target else None
                pose = _free_pose(p, others, draw.placement, is_seen)
            if pose is None:
                why = f"no free place for {p.name}"
                break
            family = name_of(p.instance)
            if family_of(p.instance) not in families_of(task):
                declared = ", ".join(map(repr, sorted({*families_of(task), family})))
                wrong = f"task {task.name}: places a {family}, which its keys do not name"
                raise UndeclaredFamily(f"{wrong}: write families = ({declared})")
            held = p.fixed, p.inside, p.slide, p.borne
            bodies[p.name] = Body(p.name, family, p.instance, pose, *held)
        else:
            if suits(bodies):
                return bodies
            why = "the layouts do not suit the robot"
    raise PlanFailure("layout", why)


def _drawn_pose(region: Region, rng: np.random.Generator) -> Pose:
    x, y = rng.uniform(min(region.x), max(region.x)), rng.uniform(*region.y)
    return yawed((x, y, region.z), rng.uniform(*region.yaw))


def _free_pose(
    p: Placement,
    others: Iterable[Body],
    rng: np.random.Generator,
    in_view: Callable[[np.ndarray], bool] | None,
) -> np.ndarray | None:
    box, region = p.instance.shape().aabb(), p.region
    for _ in range(_POSES):
        pose = _drawn_pose(region, rng)
        if (
            (in_view is None or in_view(middle(pose, p.instance)))
            and abs(pose[0]) >= region.away_from_centre
            and np.hypot(*pose[:2]) >= region.away_from_origin
            and all(_far_enough(p, (pose, box), other) for other in others)
        ):
            return pose
    return None


def _far_enough(p: Placement, outline: tuple[np.ndarray, np.ndarray], other: Body) -> bool:
    distance = float(np.hypot(*(outline[0][:2] - other.pose[:2])))
    return distance >= p.distances.get(other.name, 0.0) and apart(outline, outline_of(other), p.gap)


def suits(task: Task, bodies: dict[str, Body], sides: Collection[str]) -> bool:
    """Whether a layout asks for no other arms than those of `sides`."""
    return set(task.arms(bodies).values()) <= set(sides)


@cache
def _draw_arms(task: Task) -> frozenset[frozenset[str]]:
    layouts = (lay_out(task, _Recording(seed)) for seed in range(TRIALS))
    return frozenset(frozenset(task.arms(bodies).values()) for bodies in layouts)


def can_do(task: Task, sides: Collection[str]) -> bool:
    return set(sides) >= set(SIDES) or any(asked <= set(sides) for asked in _draw_arms(task))


def middle(pose: np.ndarray, instance: Family) -> np.ndarray:
    """World point (3,) half way up a body: what the head camera must see of a target."""
    return pose[:3] + np.array([0, 0, instance.shape().aabb()[1, 2] / 2])


def others_asked(task: Task, bodies: Mapping[str, Body], sides: Collection[str]) -> list[str]:
    """The moving bodies that an instruction can ask for in place of the target: of its family,
    named by other words than any other, within reach of `sides`."""
    target, words = task.target, dict[str, dict[str, str]]()
    for name in task.movers:
        if bodies[name].family == bodies[target].family:
            asked = in_roles(bodies, {target: name, name: target})
            words[name] = task.choices(asked) if suits(task, asked, sides) else {}
    told = [task.choices(dict(bodies)), *words.values()]
    return [name for name, choice in words.items() if choice and told.count(choice) == 1]


def admits_instruction(task: Task) -> bool:
    """Whether another of the task's bodies can be asked for."""
    drawn = (lay_out(task, _Recording(seed)) for seed in range(2 if task.movers else 0))
    return any(others_asked(task, bodies, SIDES) for bodies in drawn)


def admits_swap(task: Task) -> bool:
    """Whether nothing lies in the target."""
    return not any(placement.inside == task.target for placement in _placed(task))


def replacement(task: Task, bodies: Mapping[str, Body], rng: np.random.Generator) -> Body:
    """Another instance of the target's family for which the same words ask, waiting unseen. Raises
    PlanFailure("layout")."""
    old = bodies[task.target]
    for _ in range(_REPLACEMENTS):
        new = replace(old, name=SWAPPED, instance=type(old.instance).draw(rng), pose=AWAY)
        asked = task.choices({**bodies, task.target: new})
        if new.instance != old.instance and asked == task.choices(dict(bodies)):
            return new
    raise PlanFailure("layout", f"nothing like the {task.target} can be swapped for it")
