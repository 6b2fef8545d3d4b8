"""Which episodes an export holds: those whose specs fit an expression of `--where` (data/select.py)."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.data.select import parse_where, select_specs
from pipeline.export.shared.episodes import ExportError, reading


def expression(where: str | None, embodiments: Sequence[str]) -> str:
    """One expression from `--where` and the robots of `--embodiment`; an empty text where neither is given.

    Raises WhereError for an expression that cannot be read.
    """
    given = (where or "").strip()
    if given:
        parse_where(given)
    robots = ", ".join(f'"{name}"' for name in embodiments)
    of_robots = f"embodiment in ({robots})" if robots else ""
    return f"{of_robots} and ({given})" if of_robots and given else of_robots or given


def select_episodes(episodes: Sequence[Path], where: str) -> list[Path]:
    """The episodes that an expression selects, in their order; all of them for an empty one.

    Raises WhereError for an expression that cannot be read, ExportError if it selects no episode.
    """
    if not where:
        return list(episodes)
    wanted, specs = parse_where(where), []
    for path in episodes:
        with reading(path) as file:
            specs.append(file.spec)
    chosen = [path for path, fits in zip(episodes, select_specs(specs, wanted), strict=True) if fits]
    if not chosen:
        raise ExportError(f"no episode fits --where {where!r}: `domino-data status` lists what the dataset holds")
    return chosen
