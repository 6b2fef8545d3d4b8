"""Cells and slots of a recipe, and their episodes."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Self

from pipeline.data.spec import EpisodeSpec

DEFAULT_ALPHA = 0.1

_GOLDEN = 11400714819323198485  # 2**64 over the golden ratio: its multiples fall evenly, mod 2**64


@dataclass(frozen=True, order=True)
class Cell:
    """Task x embodiment x level x alpha x domain."""

    task: str
    embodiment: str
    level: int
    alpha: float
    domain: str

    @classmethod
    def of(cls, spec: EpisodeSpec) -> Self:
        return cls(spec.task, spec.embodiment, spec.level, spec.alpha, spec.domain)

    @property
    def path(self) -> str:
        """Directory below `episodes/`; the level carries alpha unless it is 0.1 m/s."""
        usual = self.alpha == DEFAULT_ALPHA or self.level == 0
        level = f"L{self.level}" if usual else f"L{self.level}@{self.alpha:g}"
        return f"{self.task}/{self.embodiment}/{level}/{self.domain}"

    def scenes(self, paired: Sequence[str]) -> str:
        """What the scene seeds are drawn from: the cell's path, or one text for cells that
        differ only in `paired`.
        """
        if not paired:
            return self.path
        level = "*" if "levels" in paired else str(self.level)
        alpha = "*" if "alpha" in paired else f"{self.alpha:g}"
        domain = "*" if "domains" in paired else self.domain
        return f"{self.task}/{self.embodiment}/L{level}@{alpha}/{domain}"


@dataclass(frozen=True, order=True)
class Slot:
    """One wanted episode of a cell; its variants have the same physics and other looks."""

    cell: Cell
    index: int
    variant: int = 0

    @property
    def path(self) -> str:
        """Where the episode is below `episodes/`, without suffix."""
        return f"{self.cell.path}/{episode_name(self.index, self.variant)}"

    @property
    def physical(self) -> "Slot":
        """Variant 0, whose physics this one shows."""
        return replace(self, variant=0)


def episode_name(index: int, variant: int = 0) -> str:
    """The name of an episode file without suffix."""
    return f"episode_{index:07d}_v{variant}" if variant else f"episode_{index:07d}"


@lru_cache(maxsize=8)
def episodes_by_cell(
    lists: tuple[tuple[Any, ...], ...], each: tuple[tuple[str, int], ...], total: int | None
) -> Mapping[Cell, int]:
    """Episodes of every cell of the `lists` of tasks, embodiments, levels, alphas and domains, in a
    fixed order; `each`: episodes of a cell by domain, a weight if `total`. Level 0 knows no speed,
    so it appears once.
    """
    cells = dict.fromkeys(
        Cell(task, embodiment, level, alpha if level else DEFAULT_ALPHA, domain)
        for task, embodiment, level, alpha, domain in itertools.product(*lists)
    )
    counts = {cell: dict(each).get(cell.domain, 0) for cell in cells}
    return MappingProxyType(counts if total is None else spread(counts, total))


def spread(weights: Mapping[Cell, int], total: int) -> dict[Cell, int]:
    """Exactly `total` episodes: by largest remainder over the domains, then evenly over their
    cells. A larger total takes nothing from any cell.
    """
    domains: dict[str, list[Cell]] = {}
    for cell, weight in weights.items():
        if weight:
            domains.setdefault(cell.domain, []).append(cell)
    sums = [sum(weights[cell] for cell in cells) for cells in domains.values()]
    shares = largest_remainder(sums, total)
    counts = dict.fromkeys(weights, 0)
    for cells, share in zip(domains.values(), shares, strict=True):
        counts |= dict(zip(cells, evenly(len(cells), share), strict=True))
    return counts


def largest_remainder(weights: Sequence[int], total: int) -> list[int]:
    """Whole numbers with the sum `total` in proportion to positive weights, by largest
    remainder, the first of equal ones first.
    """
    whole = sum(weights)
    counts = [total * weight // whole for weight in weights]
    order = sorted(range(len(weights)), key=lambda i: -(total * weights[i] % whole))
    for i in order[: total - sum(counts)]:
        counts[i] += 1
    return counts


def evenly(places: int, total: int) -> list[int]:
    """`total` over places: equal, with the rest spread by the golden ratio (Fibonacci hashing).
    A larger total takes nothing from any place.
    """
    order = sorted(range(places), key=lambda i: i * _GOLDEN % 2**64)
    counts = [total // places] * places
    for i in order[: total % places]:
        counts[i] += 1
    return counts
