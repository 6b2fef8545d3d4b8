"""Policies that tried the same scenes, compared scene by scene."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.errors import DominoError
from pipeline.data.reading import check_plain

from .results import EPISODES, Results, check_episode
from .statistics import SceneResult, paired_numbers, sequential
from .summary import Row, scene_of


class CompareError(DominoError): ...


@dataclass(frozen=True)
class ComparedPolicy:
    """Episodes of one policy, or of several `networks` of a kind."""

    name: str
    rows: tuple[Row, ...]
    networks: int = 1

    def by_episode(self) -> dict[str, list[Row]]:
        """Rows by what pairs them: the spec, a hash of motion and first state, clock and rules."""
        return _group(self.rows, lambda r: json.dumps([*json.loads(r["key"])[2:5], r["rules"]]))


def _group[T](items: Sequence[T], key: Callable[[T], Any]) -> dict[Any, list[T]]:
    out = defaultdict[Any, list[T]](list)
    for item in items:
        out[key(item)].append(item)
    return out


def event_arms(runs: Sequence[str]) -> list[tuple[ComparedPolicy, ComparedPolicy]]:
    """Each policy of paired evaluations without and with events, by clock and rules. Raises
    CompareError."""
    found = list[tuple[tuple[str, ...], ComparedPolicy]]()
    out, plain = list[tuple[ComparedPolicy, ComparedPolicy]](), list[str]()
    for run in runs:
        arms, before = _arms([run]), len(found) + len(out)
        for arm in arms:
            out += _conditions(arm)
            paired = [row for row in arm.rows if isinstance(row.get("control"), dict)]
            for (clock, rules), rows in _group(paired, lambda r: (r["clock"], r["rules"])).items():
                found.append(((arm.name, clock, rules, run), replace(arm, rows=tuple(rows))))
        plain += [run] if len(found) + len(out) == before else []
    if plain and (found or out):
        raise CompareError(f"{plain[0]}: has neither pairs nor conditions: compare it apart")
    check_one_benchmark([row for _, arm in found for row in arm.rows])
    for words, arm in found:
        alike = [others for others, _ in found if others[0] == words[0]]
        differing = [word for word, *each in zip(words, *alike, strict=True) if len({*each}) > 1]
        name = ", ".join((arm.name, *differing))
        calm = tuple(row | row["control"] for row in arm.rows)
        out.append((replace(arm, name=f"{name}, no events", rows=calm), replace(arm, name=name)))
    return out


def _conditions(arm: ComparedPolicy) -> Iterator[tuple[ComparedPolicy, ComparedPolicy]]:
    whole = [_without_arm(row) for row in arm.rows if row.get("condition")]
    groups = _group(whole, lambda r: (r["clock"], r["rules"]))
    for which, rows in groups.items():
        name = ", ".join((arm.name, *(which if len(groups) > 1 else ())))
        by_condition = _group(rows, lambda row: row["condition"])
        for condition in sorted(by_condition.keys() - {"none"}):
            first, second = (
                ComparedPolicy(f"{name}, {each}", tuple(by_condition[each]))
                for each in ("none", condition)
            )
            yield first, second


def _without_arm(row: Row) -> Row:
    key = json.loads(row["key"])
    spec = {name: value for name, value in json.loads(key[3]).items() if name != "arm"}
    return row | {"key": json.dumps([*key[:3], json.dumps(spec), *key[4:]])}


def read_arms(runs: Sequence[str]) -> list[ComparedPolicy]:
    """Directories joined by commas hold networks of one arm. Raises CompareError."""
    out = _arms(runs)
    if len(out) < 2:
        raise CompareError(f"{', '.join(runs)}: holds episodes of one policy: name a second run")
    if len({arm.name for arm in out}) == len(out):
        return out
    return [replace(arm, name=f"{arm.name} #{n}") for n, arm in enumerate(out, 1)]


def _arms(runs: Sequence[str]) -> list[ComparedPolicy]:
    out = list[ComparedPolicy]()
    for run in runs:
        rows = [row for part in run.split(",") for row in newest(Path(part))]
        policies = _group(rows, lambda row: row["policy"])
        if "," in run:
            grouped = tuple(row for group in policies.values() for row in group)
            out.append(ComparedPolicy(run, grouped, len(policies)))
        else:
            out += [ComparedPolicy(policy, tuple(rows)) for policy, rows in policies.items()]
    check_one_benchmark([row for arm in out for row in arm.rows])
    return out


def check_one_benchmark(rows: Sequence[Row]) -> str:
    """ "" for none. Raises CompareError for several."""
    first, *others = sorted({row.get("benchmark", "") for row in rows}) or [""]
    if others:
        raise CompareError(
            f"the episodes are on {first or 'no benchmark'} and on {others[0]}: evaluate all"
            " policies on one"
        )
    return first


def newest(run: Path) -> list[Row]:
    path = run / EPISODES
    if not path.is_file():
        raise CompareError(f"{run}: has no {EPISODES}: name the --out of a domino-data evaluate")
    # reading drops a cut-off last line, which must not be that of a file elsewhere
    check_plain(run)
    rows = Results(path, check_episode).rows()
    if not rows:
        raise CompareError(f"{path}: holds no episode yet")
    version = json.loads(rows[-1]["key"])[0]
    return [row for row in rows if json.loads(row["key"])[0] == version]


def compare(a: ComparedPolicy, b: ComparedPolicy, effect: float) -> list[dict[str, Any]]:
    pairs, tried = _pair(a, b), [len(arm.by_episode()) for arm in (a, b)]
    head = {
        "first": a.name,
        "second": b.name,
        "shared": len(pairs),
        "first_episodes": tried[0],
        "second_episodes": tried[1],
    }
    return [
        {"what": what, **head, "scenes": len(scenes)} | paired_numbers(scenes, effect)
        for what, group in _groups([row for row, _ in pairs])
        for scenes in [_scenes([pair for pair, inside in zip(pairs, group, strict=True) if inside])]
    ]


def compare_sequentially(
    a: ComparedPolicy, b: ComparedPolicy, measure: str, alpha: float
) -> dict[str, Any]:
    """Scene by scene in hash order, until `measure` decides. Raises CompareError."""
    shared = {scene_of(row) for row, _ in _pair(a, b)}
    first, second = (_means(arm.rows, measure) for arm in (a, b))
    order = sorted(shared, key=lambda scene: sha256(json.dumps(scene).encode()).digest())
    test = sequential([second[scene] - first[scene] for scene in order], alpha)
    better = {1: b.name, -1: a.name, 0: None}[test.better]
    return {"first": a.name, "second": b.name} | asdict(test) | {"better": better}


def _means(rows: Sequence[Row], measure: str) -> dict[Any, float]:
    whole = 1 if measure == "success" else 100
    return {
        scene: float(np.mean([row[measure] for row in group])) / whole
        for scene, group in _group(rows, scene_of).items()
    }


def _rate(rows: Sequence[Row]) -> float:
    return float(np.mean([row["success"] for row in rows]))


def _pair(a: ComparedPolicy, b: ComparedPolicy) -> list[tuple[Row, SceneResult]]:
    """Every episode that both arms tried. Won and lost count pairs of networks."""
    first, second = a.by_episode(), b.by_episode()
    out = list[tuple[Row, SceneResult]]()
    for key, rows in first.items():
        others = second.get(key, [])
        if len(rows) != a.networks or len(others) != b.networks:
            continue  # not tried by every network
        ends = [(row["success"], other["success"]) for row in rows for other in others]
        won, lost = sum(y and not x for x, y in ends), sum(x and not y for x, y in ends)
        out.append((rows[0], SceneResult(rows[0]["task"], _rate(rows), _rate(others), won, lost)))
    for name in ("clock", "rules") if not out else ():
        one, two = (", ".join(sorted({row[name] for row in arm.rows})) for arm in (a, b))
        if one != two:
            raise CompareError(f"{a.name} and {b.name} differ in {name}: {one} and {two}")
    if not out:
        same = "evaluate both with the same cells and --seed"
        raise CompareError(f"{a.name} and {b.name} share no episode: {same}")
    return out


def _scenes(pairs: Sequence[tuple[Row, SceneResult]]) -> list[SceneResult]:
    out = list[SceneResult]()
    for cluster in _group(pairs, lambda pair: scene_of(pair[0])).values():
        group = [scene for _, scene in cluster]
        first, second = (
            float(np.mean([getattr(s, k) for s in group])) for k in ("first", "second")
        )
        won, lost = (sum(getattr(s, k) for s in group) for k in ("won", "lost"))
        out.append(SceneResult(group[0].task, first, second, won, lost))
    return out


def _groups(rows: Sequence[Row]) -> Iterator[tuple[str, list[bool]]]:
    """Group names and their rows: all, and the parts that are not all."""
    yield "all", [True] * len(rows)
    known = {"all"}
    keys = ("clock", "level", "alpha", "domain", "category", "task", "condition", "event", "phase")
    for key in keys:
        values = sorted({row.get(key, "") for row in rows})
        for value in values if len(values) > 1 else ():
            name = f"{key} {value:g}" if key in ("level", "alpha") else value
            if name not in known:  # the event "none" is the phase "none"
                yield name, [row.get(key, "") == value for row in rows]
            known.add(name)
