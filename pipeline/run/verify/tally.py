"""What was looked at and what was wrong: one finding an observation, one check a promise."""

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pipeline.data.errors import DominoError
from pipeline.data.reading import IRREGULAR, printable

FAULTS = (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError, ValueError, DominoError)
"""What a damaged file may make h5py, numpy and our own readers raise, depending on which byte it is."""

SPELLED_OUT = 5


class Finding(NamedTuple):
    """One observation of a check; `problem` is empty if the promise is kept."""

    check: str
    problem: str = ""


def observe(check: str, ok: object, problem: str) -> Finding:
    """The observation that `ok` holds, or the problem."""
    return Finding(check, "" if ok else problem)


def named(name: str, findings: Iterable[Finding]) -> Iterator[Finding]:
    """Findings with the name of what has the problem before it."""
    return (Finding(check, problem and f"{name}: {problem}") for check, problem in findings)


def line(error: BaseException, path: object = "") -> str:
    """The message of an error in one line of at most 200 characters, without the path that it may begin with."""
    said = error.strerror if isinstance(error, OSError) and error.strerror == IRREGULAR else str(error)
    return " ".join(said.split())[:200].removeprefix(f"{path}: ") or type(error).__name__


@dataclass
class Check:
    """The result of one check: the number of things looked at and the problems; `undecided` names what could not be judged."""

    name: str
    looked: int = 0
    problems: list[str] = field(default_factory=list)
    note: str = ""
    undecided: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For printing; the first problems are spelled out."""
        detail = ", ".join(filter(None, [f"{self.looked} checked", self.note, self.undecided]))
        if self.problems:
            more = f" and {len(self.problems) - SPELLED_OUT} more" if len(self.problems) > SPELLED_OUT else ""
            detail += f"; {len(self.problems)} problems: " + "; ".join(self.problems[:SPELLED_OUT]) + more
        ok = not (self.problems or self.undecided)
        return {"name": self.name, "ok": ok, "checked": self.looked, "detail": detail, "problems": self.problems}


def closing(found: Mapping[str, Any]) -> str:
    """The last line of `verify`, from what that found: whether the dataset is sound, how many slots are not built yet, and of how
    many episodes the images could not be compared.

    A problem begins with the name of what has it.
    """
    problems = [problem for check in found["checks"] for problem in check["problems"]]
    files = len({problem.partition(": ")[0] for problem in problems})
    verdict = f"{_many(len(problems), 'problem')} in {_many(files, 'file')}; {_many(found['episodes'], 'episode')} without one"
    if not problems:
        verdict = f"{'sound' if found['ok'] else 'no problem found'}: {_many(found['episodes'], 'episode')}"
        verdict += f"; {_many(found['open'], 'slot')} not built yet" if found["open"] else ""
    return verdict + (f"; images of {_many(found['uncompared'], 'episode')} not compared" if found["uncompared"] else "")


def _many(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def count_checks(findings: Iterable[Finding]) -> tuple[tuple[tuple[str, int], ...], list[Finding]]:
    """How many observations each check made, in the order of their first, and those alone that found a problem."""
    looked, problems = dict[str, int](), list[Finding]()
    for finding in findings:
        looked[sys.intern(finding.check)] = looked.get(finding.check, 0) + 1
        if finding.problem:
            problems.append(finding)
    return tuple(looked.items()), problems


class Tally:
    """All checks of one run, by name, in the order they were first used."""

    def __init__(self) -> None:
        self.checks: dict[str, Check] = {}

    def __getitem__(self, name: str) -> Check:
        return self.checks.setdefault(name, Check(name))

    def add(self, findings: Iterable[Finding]) -> None:
        """Count observations."""
        self.add_counted(*count_checks(findings))

    def add_counted(self, looked: Iterable[tuple[str, int]], problems: Iterable[Finding]) -> None:
        """As `add`, of observations that were counted before."""
        for name, number in looked:
            self[name].looked += number
        for name, problem in problems:
            if said := printable(problem):
                self[name].problems.append(said)
