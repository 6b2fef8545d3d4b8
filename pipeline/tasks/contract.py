"""What a task is: a layout, a script in two halves and named success conditions; see
docs/add_a_task.md."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np

from pipeline.data.episode.meta import Category
from pipeline.data.errors import DominoError
from pipeline.data.setup.rules import STRICT, Rules
from pipeline.expert.actor import Actor, Skills
from pipeline.motion.workspace import Workspace
from pipeline.registry import Registry, place_in
from pipeline.world.objects.contract import FAMILIES, Family, Slide, stands_for
from pipeline.world.physics.body import TABLE_TOP, Body

from .language.sentences import has_templates, read_templates
from .outcome import Outcome
from .outcome import within as within  # what a task file needs, beside the skills, is here

INTERCEPTION: Final = "interception"
TRACKING: Final = "tracking"
type Span = tuple[float, float]
ANY_YAW: Span = (-3.14, 3.14)  # rad


@dataclass(frozen=True)
class Limit[T]:
    """A number, or a tuple of numbers, under strict rules and under domino rules (None: the same,
    or not needed). `unit` is "m", "rad" or "" for a plain number."""

    strict: T
    domino: T | None = None
    unit: str = "m"

    def under(self, rules: Rules) -> T:
        return self.strict if rules.name == "strict" or self.domino is None else self.domino


def by_name[T](**values: T) -> Mapping[str, T]:
    """Limits or subgoals by name, read-only."""
    return MappingProxyType(values)


@dataclass(frozen=True)
class Region:
    """Where a body's origin may stand on the table (m), its yaw (rad), how far from x = 0 and from
    the world's origin at least. `z` (m) is the height of what it stands on."""

    x: Span
    y: Span
    yaw: Span = (0.0, 0.0)
    away_from_centre: float = 0.0
    away_from_origin: float = 0.0
    z: float = TABLE_TOP


@dataclass(frozen=True, eq=False)
class Placement:
    """One line of a layout: a named instance and its region; `gap` (m) keeps its footprint from
    those placed before, `distances` (m) its origin from theirs, by name.

    A `fixed` body never moves. With a `slide` it runs in the body that it is `inside` like a
    drawer. A `borne` body is held in the air at the region's `z`. With `inside`, the name of a body
    placed before, the region is in that body's frame and no room is kept; see Body. The middle of a
    `shown` body is in the head camera's image, as that of the target always is."""

    name: str
    instance: Family
    region: Region
    fixed: bool = False
    gap: float = 0.02
    inside: str = ""
    slide: Slide | None = None
    distances: Mapping[str, float] = field(default_factory=dict[str, float])
    borne: bool = False
    shown: bool = False


Bodies = Iterator[Placement]  # a layout, in the order of placing


class Draw:
    """The random choices of a layout, each from its own stream."""

    def __init__(
        self, objects: np.random.Generator, placement: np.random.Generator, rules: Rules = STRICT
    ) -> None:
        self._objects, self.placement, self.rules = objects, placement, rules

    def one_of(self, *families: str, **given: Any) -> Family:
        """An instance of one of the named families, or an object that replaces it; `given`
        parameters are not drawn. Raises UndeclaredFamily if an object from files would have to take
        them."""
        family = families[int(self._objects.integers(len(families)))]
        kind = drawn_kind(family, self.rules, self._objects)
        if given and stands_for(kind):
            wrong = "is given by the task; an object from a file has its own"
            raise UndeclaredFamily(f"objects: {family}: its {', '.join(given)} {wrong}")
        draw_one: Callable[..., Family] = kind.draw
        return draw_one(self._objects, **given)

    def place(self, name: str, *families: str, x: Span, y: Span, **more: Any) -> Placement:
        """A body of one of `families`, or of that of its name, in the region `x`, `y` (m).
        `more` are fields of Region and Placement, and parameters of the family that are not
        drawn."""
        region, placed = (
            {key: more.pop(key) for key in kind.__dataclass_fields__.keys() & more.keys()}
            for kind in (Region, Placement)
        )
        body = self.one_of(*families or (name,), **more)
        return Placement(name, body, Region(x, y, **region), **placed)

    def side(self) -> int:
        """-1 (left half of the table) or +1 (right half)."""
        return int(self.placement.integers(2)) * 2 - 1

    def uniform(self, low: float, high: float) -> float:
        """A number of the placement stream."""
        return float(self.placement.uniform(low, high))

    def several[T](self, options: Sequence[T], count: int) -> list[T]:
        """Choose `count` different options in a random order, from the placement stream."""
        return [options[int(i)] for i in self.placement.permutation(len(options))[:count]]


class Task(ABC):
    """Base of the tasks, without state: layout, arms, script and success.

    `target` moves on its own until the meeting; `manipulated` is the body that the arms handle.
    By default another one than the target makes the `category` "tracking", else "interception".
    `motion` and `movers` name default motion models; `workspace` bounds the target's path. `limits`
    are tolerances by name; "lift" requires that the manipulated body once rose that far. Domino
    rules leave out `own_conditions`. `subgoals` lists the conditions of each part of a long task.
    `seen` and `unseen` are read from phrases/<name>.txt unless set. `suite` is the folder in the
    library, or "own"."""

    name: ClassVar[str] = ""
    suite: ClassVar[str] = ""
    category: ClassVar[Category]
    step_limit: ClassVar[int] = 400
    target: ClassVar[str]
    manipulated: ClassVar[str] = ""
    motion: ClassVar[str] = "planar"
    movers: ClassVar[Mapping[str, str]] = {}
    workspace: ClassVar[Workspace] = Workspace(-0.35, 0.35, -0.25, 0.25)
    limits: ClassVar[Mapping[str, Limit[float]]] = by_name()
    sizes: ClassVar[Mapping[str, Limit[Any]]] = by_name()
    own_conditions: ClassVar[tuple[str, ...]] = ("at_rest", "released")
    subgoals: ClassVar[Mapping[str, tuple[str, ...]]] = by_name()
    families: ClassVar[tuple[str, ...]] = ()
    seen: ClassVar[tuple[str, ...]]
    unseen: ClassVar[tuple[str, ...]]
    least_seen: ClassVar[int] = 50
    least_unseen: ClassVar[int] = 10

    @abstractmethod
    def layout(self, draw: Draw) -> Bodies:
        """Bodies in the order of placement, the target at its manipulation pose."""

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        """Roles of the arms: by default one `arm`, on the side of the manipulated body."""
        return {"arm": side_of(bodies[self.manipulated])}

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        """Words by slot that name the one of like bodies, such as {"choice": "red"}."""
        return {}

    @abstractmethod
    def meet(self, a: Actor) -> Skills:
        """Planned in the still scene; its last skill must touch the target."""

    def finish(self, a: Actor) -> Skills:
        """Planned live from wherever things are after the meeting."""
        yield from ()

    @abstractmethod
    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        """The success conditions by name, the same at every frame; all must hold at the last one.

        A name without that of a body is about the manipulated body. No condition may raise."""

    def under(self, rules: Rules) -> dict[str, float]:
        return {name: limit.under(rules) for name, limit in self.limits.items()}

    def conditions(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        """The success conditions, and that the manipulated body was lifted if there is a "lift".
        Strict rules of tracking tasks add that the handled body touched the target first."""
        conditions = self.success(o, arms)
        if (lift := self.under(o.rules).get("lift")) is not None:
            conditions["was_lifted"] = o.highest_rise(self.manipulated) > lift
        if o.rules.name == "domino":
            return {k: holds for k, holds in conditions.items() if k not in self.own_conditions}
        if self.category == TRACKING and self.manipulated != self.target:
            conditions[f"met_by_{self.manipulated}"] = o.met_by() == self.manipulated
        return conditions


class UndeclaredFamily(DominoError):
    """A layout asked for a family that its task does not declare."""


TASKS = Registry[Task]("task")
DOMINO: Final = "domino"  # the suite of the paper's 35 tasks, which `all` means
LIBRARY: Final = "pipeline.tasks.library."


def suites() -> dict[str, tuple[str, ...]]:
    """Names of the tasks of every suite, sorted."""
    by_suite: dict[str, list[str]] = {}
    for name in sorted(TASKS):
        by_suite.setdefault(TASKS[name].suite, []).append(name)
    return {suite: tuple(names) for suite, names in by_suite.items()}


def expand_tasks(names: Iterable[str]) -> tuple[str, ...]:
    """Tasks of names and suites; none, or `all`, are those of `domino`."""
    known, requested = suites(), tuple(names) or ("all",)
    suites_or_tasks = (DOMINO if name == "all" else name for name in requested)
    return tuple(dict.fromkeys(x for name in suites_or_tasks for x in known.get(name, (name,))))


def register[T: Task](cls: type[T]) -> type[T]:
    """Class decorator: enter a task under its name in snake case, with its templates.

    Raises ValueError for a bad name or templates, TypeError.
    """
    name = "".join(f"_{c.lower()}" if c.isupper() else c for c in cls.__name__).lstrip("_")
    place_in(sys._getframemodulename(1), cls)
    cls.name = name
    cls.manipulated = cls.manipulated or cls.target
    if not hasattr(cls, "category"):
        cls.category = INTERCEPTION if cls.manipulated == cls.target else TRACKING
    folder = cls.__module__.removeprefix(LIBRARY).partition(".")[0]
    cls.suite = folder if cls.__module__.startswith(LIBRARY) else cls.suite or "own"
    if "seen" not in vars(cls) and (
        has_templates(name, cls.__module__) or not hasattr(cls, "seen")
    ):
        cls.seen, cls.unseen = read_templates(name, cls.__module__)
    for split in ("seen", "unseen"):
        count, least = len(getattr(cls, split)), getattr(cls, f"least_{split}")
        if count < least:
            raise ValueError(f"task {name!r} has {count} {split} templates: write at least {least}")
    TASKS.add(name, cls())
    return cls


def side_of(body: Body) -> str:
    return "left" if body.pose[0] < 0 else "right"


def other_side(side: str) -> str:
    return "left" if side == "right" else "right"


def sign_of(side: str) -> int:
    """The sign of x on the half of the table of an arm: -1 for left, 1 for right."""
    return -1 if side == "left" else 1


def name_of(instance: Family) -> str:
    return next(name for name, family in FAMILIES.items() if family is type(instance))


def family_of(instance: Family) -> str:
    """The family of an instance; of an object from files the one that it stands for."""
    return stands_for(type(instance)) or name_of(instance)


def drawn_kind(family: str, rules: Rules, rng: np.random.Generator) -> type[Family]:
    """The family that a layout asked for, or one of its replacements."""
    names = dict(rules.objects).get(family) or (family,)
    return FAMILIES[names[0] if len(names) == 1 else names[int(rng.integers(len(names)))]]
