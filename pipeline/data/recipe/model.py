"""A recipe: which episodes a dataset is to hold, as cells and slots."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from pipeline.data.episode.meta import NamedCamera
from pipeline.data.keys import digest
from pipeline.data.names import NONE, is_embodiment, is_name
from pipeline.data.parsing import line, show_value
from pipeline.data.setup import RecipeError, Seed, Setup
from pipeline.data.setup.rules import Corrections, Expert, Perturbation, Sight, Takeover
from pipeline.data.spec import (
    CONTROL,
    EVENTFUL,
    HIGHEST_LEVEL,
    MOST_CONDITIONS,
    EpisodeSpec,
    attempt_seed,
    condition_arms,
)

from .cells import DEFAULT_ALPHA, Cell, Slot, episodes_by_cell

MOST_SLOTS = 10_000_000  # episodes of one dataset
SLOWEST = 1e-3  # m/s

CHOOSING = (
    *("name", "tasks", "embodiments", "levels", "domains", "alpha"),
    *("episodes", "total", "variants", "assets"),
)
"""Keys that choose slots and change none: a dataset may grow by them."""

_Count = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]
_Thousand = Annotated[int, Field(ge=1, le=1000, strict=True)]
_Title = Annotated[str, AfterValidator(lambda text: line(text, 200))]


def _scheme(text: str) -> str:
    if not text.startswith("robotwin:") or not text.removeprefix("robotwin:"):
        raise ValueError("is not written as robotwin:DIR")
    return text


class Recipe(Setup):
    """What a dataset is made of: its setup and which episodes, with the defaults of a bare
    `build`."""

    name: _Title = "domino"
    """A label of the dataset: a resume may change it, and makes no episode again."""
    seed: Seed = 0
    """Seed from which the seeds of all attempts follow."""
    embodiments: tuple[str, ...] = ("aloha-agilex",)
    """Robots by name or alias (`domino-data embodiments`); two unlike arms are written left+right,
    one NAME+none or none+NAME."""
    tasks: tuple[str, ...] = ()
    """Names of tasks (`domino-data tasks`) and of suites of tasks; `all`, or none, is the suite
    `domino`, the paper's 35."""
    levels: tuple[Annotated[int, Field(ge=0, le=HIGHEST_LEVEL)], ...] = (1, 2, 3)
    """How the target moves: 0 is static; of the paper's motions 1 is constant velocity, 2
    polynomial, 3 two or three abrupt pieces."""
    domains: tuple[Literal["clean", "randomized"], ...] = ("clean",)
    """Looks and surroundings: clean, or randomized with distractors, other table heights and camera
    poses."""
    alpha: tuple[Annotated[float, Field(ge=0, le=2)], ...] = (DEFAULT_ALPHA,)
    """Speed coefficients of the target, m/s; 0 is a static target at every level."""
    episodes: (
        _Count
        | Mapping[
            Literal["clean", "randomized"], Annotated[int, Field(ge=0, le=1_000_000, strict=True)]
        ]
    ) = 50
    """Episodes per cell (task x robot x level x alpha x domain); also a mapping such as {clean: 50,
    randomized: 10}."""
    total: Annotated[int, Field(ge=1, le=MOST_SLOTS, strict=True)] | None = None
    """Exact number of episodes of all cells, spread evenly over them; `episodes` are then the
    weights of the domains."""
    paired: tuple[Literal["levels", "domains", "alpha", "events", "conditions"], ...] = ()
    """Cells that differ only in these keys try the same scenes slot by slot: same layout, objects
    and looks. With `events`, slots 2k and 2k + 1 are one scene with and without its events;
    with `conditions`, a scene is tried with every set of its events."""
    attempts: _Thousand = 30
    """Seeds tried for one slot before it is given up."""
    variants: _Thousand = 1
    """Number of looks in which every physics episode is drawn."""
    assets: Annotated[str, AfterValidator(_scheme)] | None = None
    """The original's objects in place of ours, in every task that has some: robotwin:DIR, its
    directory assets/objects."""
    expert: Expert = "planned"
    """The demonstrator: the planned expert knows where and when it meets the target, the reactive
    one sees only the past, follows the target and tries again."""
    sight: Sight = Sight()
    """Delay and error with which the reactive expert sees the target: 100ms,5mm; in a file also
    {delay: 0.1, noise: 0.005} (s, m)."""
    corrections: Corrections | None = None
    """A policy (as for `evaluate --policy`) that acts first; the reactive expert labels every
    frame, takes over and finishes."""
    takeover: Takeover = "time"
    """When the expert takes over from the policy: at a drawn time before the planned meeting, or
    when the policy's hand is farther off the expert's path than a drawn distance (error)."""
    perturb: Perturbation | None = None
    """What happens to the robot between the policy's turn and the expert's: nothing, a pause of
    drawn length, or a push in a drawn direction. Needs `corrections`."""
    view: Literal["any", "unoccluded"] = "any"
    """`unoccluded` rejects attempts in which the head camera does not see the target well before
    the meeting: at least 25 % of its silhouette in at least half of the frames of the last 0.5
    s."""
    instructions: _Thousand = 100
    """Number of sentences for each of the splits seen and unseen."""
    keep_failures: Literal["all", "rendered", "none"] = "none"
    """Failed attempts stored as files below failures/: `rendered` those of the replay, `all` also
    those of dry runs."""

    @property
    def reactive(self) -> Sight | None:
        """How the reactive expert that demonstrates or corrects sees."""
        return self.sight if self.expert == "reactive" or self.corrections else None

    @property
    def label(self) -> str:
        """That of the setup, and the expert unless it is the planned one."""
        if self.reactive is None:
            return super().label
        label = f"{super().label}-reactive-delay{self.sight.delay:g}-noise{self.sight.noise:g}"
        if self.corrections:
            label += f"-takeover-{self.takeover}-{digest([self.corrections.label])[:8]}"
        return f"{label}-{self.perturb}" if self.perturb else label

    @field_validator("tasks", "embodiments", "levels", "domains", "alpha", "paired", mode="before")
    @classmethod
    def _listed(cls, value: Any, info: ValidationInfo) -> Any:
        return listed(value, str(info.field_name))

    @field_validator("paired")
    @classmethod
    def _in_order(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(
            sorted(value, key=("levels", "domains", "alpha", "events", "conditions").index)
        )

    @field_validator("alpha")
    @classmethod
    def _apart(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        """Speeds that are some, with directories of their own."""
        if any(0 < alpha < SLOWEST for alpha in value):
            fix = "level 0 is a target that stands still"
            raise ValueError(f"holds a speed below {SLOWEST} m/s, which is no motion; {fix}")
        if len({f"{alpha:g}" for alpha in value}) < len(value):
            raise ValueError("holds two speeds that are equal to six digits: they name directories")
        return value

    @field_validator("episodes", mode="before")
    @classmethod
    def _by_domain(cls, value: Any) -> Any:
        unknown = [*value.keys() - {"clean", "randomized"}] if isinstance(value, Mapping) else []
        if unknown:
            fix = "write a number, or {clean: 50, randomized: 10}"
            raise ValueError(f"names the domain {show_value(unknown[0])}; {fix}")
        return value

    @field_validator("cameras")
    @classmethod
    def _some(cls, value: tuple[str | NamedCamera, ...]) -> tuple[str | NamedCamera, ...]:
        if not value:
            raise ValueError("is empty")
        return value

    @field_validator("variants")
    @classmethod
    def _differ(cls, value: int, info: ValidationInfo) -> int:
        if value > 1 and info.data.get("visuals", "randomized") != "randomized":
            raise ValueError("would all look the same: more than 1 needs visuals: randomized")
        return value

    def counts(self) -> Mapping[Cell, int]:
        """Physics episodes of every cell, in a fixed order."""
        of = self.episodes
        lists = (self.tasks, self.embodiments, self.levels, self.alpha, self.domains)
        each = tuple((d, of if isinstance(of, int) else of.get(d, 0)) for d in self.domains)
        return episodes_by_cell(lists, each, self.total)

    def cells(self) -> list[Cell]:
        """All cells, in a fixed order."""
        return list(self.counts())

    def robots(self) -> list[str]:
        """The single robots of the embodiments, sorted."""
        return sorted({name for pair in self.embodiments for name in pair.split("+")} - {NONE})

    def wanted(self, cell: Cell) -> int:
        """Episodes wanted of a cell."""
        return self.counts().get(cell, 0)

    def slots(self) -> Iterator[Slot]:
        """Every wanted episode: the physical slots, each followed by its other variants."""
        for slot in self.physical_slots():
            for variant in range(self.variants):
                yield replace(slot, variant=variant)

    def physical_slots(self) -> Iterator[Slot]:
        """Variant 0 of every slot: all cells' first, then all second ones, so that an interrupted
        build is balanced."""
        counts = self.counts()
        for index in range(max(counts.values(), default=0)):
            for cell, count in counts.items():
                if index < count:
                    yield Slot(cell, index)

    def spec(self, slot: Slot, attempt: int) -> EpisodeSpec:
        """The spec of an attempt at a slot. Paired cells have the same seeds.

        The first half of the attempts share the drawn shape and speed of the target's motion, so
        that a slow motion does not replace a fast one, which seldom fits."""
        cell, index, arm = slot.cell, slot.index, ""
        if arms := self.arms:
            index, arm = index // len(arms), arms[index % len(arms)]
        scenes = cell.scenes(self.paired)
        seed = attempt_seed(self.seed, scenes, index, attempt)
        shared = None
        if attempt <= self.attempts // 2:
            shared = attempt_seed(self.seed, scenes, index, -1)
        drawn = {"slot": slot.index, "seed": seed, "slot_seed": shared, "arm": arm}
        return EpisodeSpec(**vars(cell), **drawn)

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms of every scene if its events are paired."""
        if "conditions" in self.paired:
            return condition_arms(len(self.events))
        return (EVENTFUL, CONTROL) if "events" in self.paired else ()

    def to_yaml(self) -> str:
        """The recipe as YAML, every field written out."""
        values = self.model_dump(mode="json")
        values["events"] = [e.model_dump(mode="json", exclude_defaults=True) for e in self.events]
        keys = [key for key in KEYS if key != "events" or self.events]
        return yaml.safe_dump({key: values[key] for key in keys}, sort_keys=False)


KEYS = (*(key for key in Recipe.model_fields if key not in Setup.model_fields), *Setup.model_fields)
"""The keys of a recipe as files list them: which episodes, then the setup."""


def parse_recipe(
    values: Mapping[str, Any], source: str = "recipe", flags: Mapping[str, str] | None = None
) -> Recipe:
    """As `Recipe.parse`, checked by `check_size`; `run.names` checks tasks and robots."""
    recipe = Recipe.parse(values, source, flags)
    check_size(recipe, source)
    return recipe


def check_size(recipe: Recipe, source: str = "recipe") -> None:
    """Raise RecipeError for no episode, or too many; no tasks count for one."""
    if not recipe.tasks:
        recipe = recipe.model_copy(update={"tasks": ("all",)})
    lists = (recipe.tasks, recipe.embodiments, recipe.levels, recipe.alpha, recipe.domains)
    if (cells := math.prod(map(len, lists))) > MOST_SLOTS:
        many, fix = f"has {cells} cells", "name fewer tasks, robots or alphas"
        raise RecipeError(f"{source}: {many}: a dataset has 1 to {MOST_SLOTS} episodes; {fix}")
    of_events = [key for key in recipe.paired if key in ("events", "conditions")]
    if len(of_events) > 1:
        raise RecipeError(f"{source}: paired: events and conditions exclude each other")
    if of_events and not recipe.events:
        raise RecipeError(f"{source}: paired: {of_events[0]} needs events, and there are none")
    if "conditions" in of_events and len(recipe.events) > MOST_CONDITIONS:
        raise RecipeError(f"{source}: paired: conditions takes {MOST_CONDITIONS} events at most")
    arms = len(recipe.arms)
    if arms and any(count % arms for count in recipe.counts().values()):
        raise RecipeError(
            f"{source}: paired: {of_events[0]} needs a multiple of {arms} episodes in every cell"
        )
    episodes = recipe.variants * sum(recipe.counts().values())
    if not 0 < episodes <= MOST_SLOTS:
        many, fix = f"wants {episodes} episodes", "change episodes, alpha or variants"
        raise RecipeError(f"{source}: {many}: a dataset has 1 to {MOST_SLOTS}; {fix}")


def listed(value: Any, key: str) -> tuple[str | int | float, ...]:
    """The values of a key without repeats; a single value is a list of one. Only `tasks` and
    `paired` may be empty. Raises ValueError."""
    items = value if isinstance(value, list | tuple) else [value]
    if not all(isinstance(item, str | int | float) for item in items):
        raise ValueError("is not a list of names or numbers")
    if not items and key not in ("tasks", "paired"):
        raise ValueError("is empty")
    checks = {"tasks": (is_name, "a name"), "embodiments": (is_embodiment, "NAME or LEFT+RIGHT")}
    if key in checks:
        holds, form = checks[key]
        if wrong := [item for item in items if not holds(item)]:
            raise ValueError(f"holds {show_value(wrong[0])}, which is not {form}")
    return tuple(dict.fromkeys(items))
