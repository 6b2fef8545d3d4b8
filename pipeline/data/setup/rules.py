"""By which rules an episode is made and judged."""

import re
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, cast, get_args

from pydantic import Field, model_validator

from pipeline.data.episode.events import EventSpec
from pipeline.data.episode.meta import CLUTTER, Category, EpisodeMeta
from pipeline.data.imperfections import DriveErrors
from pipeline.data.keys import digest
from pipeline.data.parsing import Strict

RuleSet = Literal["strict", "domino"]
Contact = Literal["stop", "continue", "hold"]
Layout = Literal["ours", "original"]
Expert = Literal["planned", "reactive"]
Takeover = Literal["time", "error"]
Perturbation = Literal["pause", "push"]

MOST_CLUTTER = 10  # as many as the original's


_UNITS = {"s": ("delay", 1.0), "ms": ("delay", 1e-3), "m": ("noise", 1.0), "mm": ("noise", 1e-3)}
_AMOUNT = re.compile(r"(?P<number>[0-9]{1,6}(\.[0-9]{1,6})?) ?(?P<unit>ms|s|mm|m)")


class Sight(Strict):
    """How the reactive expert sees the target: `delay` (s) late, with errors of standard deviation
    `noise` (m)."""

    delay: Annotated[float, Field(ge=0, le=2)] = 0.0
    noise: Annotated[float, Field(ge=0, le=0.1)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _written(cls, value: Any) -> Any:
        """ "100ms,5mm" is {delay: 0.1, noise: 0.005}."""
        if not isinstance(value, str):
            return value
        words = [_AMOUNT.fullmatch(word.strip()) for word in value.split(",")]
        found = {
            _UNITS[word["unit"]][0]: round(float(word["number"]) * _UNITS[word["unit"]][1], 9)
            for word in words
            if word
        }
        if len(found) < len(words):
            raise ValueError("is not written as a delay and an error, such as 100ms,5mm")
        return found


class Corrections(Strict):
    """Whose actions the reactive expert corrects: a `policy` as of `evaluate --policy`, and its
    `label` with the hash of its file (run/names.py)."""

    policy: Annotated[str, Field(min_length=1, max_length=1000)]
    label: Annotated[str, Field(max_length=1000)] = ""

    @model_validator(mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        return {"policy": value} if isinstance(value, str) else value


@dataclass(frozen=True)
class Rules:
    """`name`: "strict" are ours, "domino" the sizes, tolerances and conditions of the original's
    dynamic tasks.

    `contact` is what the first touch does to the target. "stop" ends its own motion (the paper's
    text), the default of "strict". "continue" lets that of a tracking task go on (the original's
    evaluation), the default of "domino". "hold" makes it a dynamic body that a drive of bounded
    force keeps on its motion until something has hold of it (world/physics/drive.py).

    `layout` is where the robot's bases are, `clutter` the fewest and most distractors, `objects`
    those from files by family or `task.family`."""

    name: RuleSet = "strict"
    contact: Contact | None = None
    layout: Layout = "ours"
    clutter: tuple[int, int] = CLUTTER
    objects: tuple[tuple[str, tuple[str, ...]], ...] = ()
    drive: DriveErrors | None = None
    events: tuple[EventSpec, ...] = ()

    def within(self, task: str) -> "Rules":
        """The same with the objects of this task."""
        own = {
            key.removeprefix(f"{task}."): names
            for key, names in self.objects
            if key.startswith(f"{task}.")
        }
        return replace(self, objects=tuple((dict(self.objects) | own).items())) if own else self

    def after_touch(self, category: Category) -> Contact:
        """What the first touch does to the target of a task of this category."""
        contact = self.contact or ("stop" if self.name == "strict" else "continue")
        return "stop" if contact == "continue" and category == "interception" else contact

    @property
    def label(self) -> str:
        """A word for paths and tables, such as "strict-continue"."""
        layout = self.layout if self.layout != "ours" else None
        clutter = None if self.clutter == CLUTTER else "clutter{}to{}".format(*self.clutter)
        objects = f"objects{digest(self.objects)[:6]}" if self.objects else None
        drive = self.drive and self.drive.label
        events = "+".join(event.label for event in self.events)
        words = (self.name, self.contact, layout, clutter, objects, drive, events)
        return "-".join(word for word in words if word)


STRICT = Rules()


def rules_of(meta: EpisodeMeta) -> Rules:
    """The rules of a stored episode. Raises ValueError for unknown ones."""
    for value, known in ((meta.rules, RuleSet), (meta.contact, Contact), (meta.layout, Layout)):
        if value not in get_args(known):
            raise ValueError(f"{value!r} is not one of {', '.join(get_args(known))}")
    objects = tuple((family, tuple(names)) for family, names in sorted(meta.objects_wanted.items()))
    return Rules(
        cast(RuleSet, meta.rules),
        cast(Contact, meta.contact),
        cast(Layout, meta.layout),
        meta.clutter_wanted,
        objects,
        meta.drive,
    )
