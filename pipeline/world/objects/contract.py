"""Object families: parameters drawn once; shape, frames and words follow."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol, Self, dataclass_transform

import numpy as np

from pipeline.poses import Pose
from pipeline.registry import Registry, place_in
from pipeline.world.shapes import Shape


@dataclass(frozen=True, eq=False)
class Grasp:
    """A two-finger grasp: the tcp in the object frame (x approach, y opening), thickness (m)
    between the fingers, and a kind such as "side" or "rim"."""

    pose: Pose
    width: float
    kind: str = "side"


@dataclass(frozen=True, eq=False)
class NamedFrames:
    """Functional frames (z = outward normal) and grasp candidates in the object frame."""

    points: Mapping[str, Pose]
    grasps: tuple[Grasp, ...] = ()

    def __getitem__(self, name: str) -> Pose:
        if name not in self.points:
            raise KeyError(f"no frame {name!r}; this object has {', '.join(sorted(self.points))}")
        return self.points[name]


@dataclass(frozen=True)
class Words:
    """Words of an object: a `noun` for detectors, phrases without article for instructions."""

    noun: str
    seen: tuple[str, ...]
    unseen: tuple[str, ...]


@dataclass(frozen=True)
class Slide:
    """A prismatic joint: unit `axis` in the parent's frame, limits (m) from the start."""

    axis: tuple[float, float, float]
    lower: float
    upper: float


class Family(Protocol):
    """Frozen dataclasses of a family's parameters (lengths in metres)."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Sample an instance; every draw comes from `rng`."""
        ...

    def shape(self) -> Shape:
        """Origin at the centre of the base, z up."""
        ...

    def frames(self) -> NamedFrames:
        """Always contains "base" (origin) and "top"."""
        ...

    def words(self) -> Words:
        """Descriptions that are true of this instance."""
        ...


FAMILIES = Registry[type[Family]]("object family")


def directory_of(family: type[Family]) -> Any:
    """The from_files.Directory of an object from files, else None."""
    return getattr(family, "directory", None)


def stands_for(family: type[Family]) -> str | None:
    """The family that an object from files stands for, else None."""
    directory = directory_of(family)
    return None if directory is None else directory.settings.family


@dataclass_transform(frozen_default=True)
def register[F: type](name: str) -> Callable[[F], F]:
    """Class decorator: enter a family under `name` (snake case), as a frozen dataclass. Raises
    ValueError for a taken name. Shapes and frames are cached: arrays are read-only."""

    module = sys._getframemodulename(1)

    def enter(cls: F) -> F:
        if "__dataclass_fields__" not in vars(cls):
            dataclass(frozen=True)(cls)
        place_in(module, cls)
        FAMILIES.add(name, cls)
        for method in ("shape", "frames"):
            setattr(cls, method, lru_cache(maxsize=4)(getattr(cls, method)))
        return cls

    return enter
