"""check-result: whether results are whole and reproducible."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.reading import check_tree, read_regular
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.bundle import (
    BUNDLE,
    BundleError,
    RecordedResult,
    actions_file,
    hash_rows,
    hash_scenes,
    read_bundle,
    unpack,
)
from pipeline.evaluate.scenes.benchmark import Benchmark, read_benchmark, shipped_benchmarks
from pipeline.evaluate.scenes.case import BenchmarkError, Case, in_every_arm, start_of_trial
from pipeline.evaluate.scenes.manifests import Manifests, Runner
from pipeline.evaluate.scenes.trial import Trial
from pipeline.evaluate.scoring.clock import Clock, parse_clock
from pipeline.evaluate.scoring.metrics import score
from pipeline.evaluate.scoring.results import EPISODES, Results, check_episode
from pipeline.evaluate.scoring.summary import Row
from pipeline.poses import Floats

from .evaluation import evaluation_version
from .provenance import machine

PHYSICAL = ("packages", "processor")
"""Of `made_by`: what must be the same for the same bytes."""

type Cases = Mapping[tuple[str, str], Case]
"""The cases of an evaluation by spec and digest."""


@dataclass
class CheckedBundle:
    """`faults` name what was changed; `exact`: every number was compared."""

    episodes: int = 0
    again: int = 0
    exact: bool = True
    faults: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class ReplayJob:
    """What an episode of a case commanded, to be carried out again."""

    case: Case
    clock: Clock
    result: RecordedResult
    row: Mapping[str, Any]
    commands: Floats

    def __str__(self) -> str:
        return _named(self.row)


def check_result(
    out: Path,
    run: Runner,
    again: int = 0,
    seed: int | None = None,
    manifests: Path | None = None,
    benchmark: Benchmark | None = None,
) -> CheckedBundle:
    """Check a directory of an evaluation. `again` random episodes are run again, without which
    consistent forgeries pass. Raises BundleError, OSError, ResultsError, ProtocolError,
    BenchmarkError.
    """
    check_tree(out)
    checked, jobs, known = CheckedBundle(), list[ReplayJob](), set[str]()
    results = read_bundle(out)
    if not results:
        raise BundleError(f"{out}: has no {BUNDLE}: name the --out of a domino-data evaluate")
    rows = Results(out / EPISODES, check_episode).rows()
    here = machine()
    for result in results:
        cases = _cases(result, manifests or out / "manifests", benchmark)
        mine = [
            row
            for row in rows
            if result.owns(key := json.loads(row["key"])) and (key[3], key[4]) in cases
        ]
        known |= {row["key"] for row in mine}
        checked.faults += [f"{result.policy}: {f}" for f in _differences(result, mine, cases)]
        same = all(result.made_by.get(key) == here[key] for key in PHYSICAL)
        checked.exact &= same and result.code == evaluation_version()
        jobs += _jobs(out, result, mine, cases, checked.faults)
    checked.episodes = len(known)
    if foreign := len(rows) - len(known):
        checked.faults.append(f"{foreign} rows are of no policy and scene of {BUNDLE}")
    chosen = Random(seed).sample(jobs, min(again, len(jobs)))
    for job, numbers in run(carry_out_again, chosen) if chosen else ():
        checked.again += 1
        checked.faults += [
            f"{job}: {name} is {job.row.get(name)}, and {numbers[name]} when its actions are"
            " carried out again"
            for name in (numbers if checked.exact else ("success",))
            if job.row.get(name) != numbers[name]
        ]
    return checked


def _named(row: Mapping[str, Any]) -> str:
    return f"{row['task']} on {row['embodiment']}, level {row['level']}, seed {row['seed']}"


def _cases(result: RecordedResult, manifests: Path, benchmark: Benchmark | None) -> Cases:
    """The evaluation's cases. Raises BenchmarkError."""
    cells = result.read_cells()
    if result.benchmark:
        name, digest = result.benchmark.name, result.benchmark.sha256
        if benchmark is None and name not in shipped_benchmarks():
            raise BenchmarkError(f"benchmark {name} does not ship here: name its file, --benchmark")
        benchmark = benchmark or read_benchmark(name)
        if (benchmark.head.benchmark, benchmark.sha256) != (name, digest):
            raise BenchmarkError(
                f"the results are of a benchmark {name} (sha256 {digest[:12]}), which is not"
                f" {benchmark.label}: give its file with --benchmark"
            )
        admitted = benchmark.cases(cells, result.episodes)
    else:
        seeds = Manifests(manifests, result.seed, result.read_setup().calm, result.apart)
        admitted = {cell: seeds.read(cell).cases[: result.episodes] for cell in cells}
    if result.conditions:
        admitted = in_every_arm(admitted, len(result.read_setup().events))
    every = (case for cases in admitted.values() for case in cases)
    return {(case.spec.to_json(), case.digest): case for case in every}


def _differences(result: RecordedResult, rows: Sequence[Row], cases: Cases) -> Iterator[str]:
    if hash_scenes(cases.values()) != result.scenes:
        yield "its scenes are not those that it was made on"
    if hash_rows(rows) != result.rows:
        yield "its rows are not those that were written"
    arms = 2 ** len(result.read_setup().events) if result.conditions else 1
    wanted = result.episodes * len(result.cells) * arms
    if len(cases) < wanted:
        yield f"{wanted - len(cases)} of {wanted} scenes are missing from the manifests"
    tried = {tuple(json.loads(row["key"])[3:5]) for row in rows}
    if dropped := cases.keys() - tried:
        yield f"{len(dropped)} episodes are missing, such as {sorted(dropped)[0][0]}"
    label = result.benchmark and result.benchmark.label
    stated = [result.policy, result.clock, result.probe, result.read_setup().label, label]
    for row in rows:
        spec = json.loads(json.loads(row["key"])[3])
        claimed = [row["policy"], row["clock"], row["probe"], row["rules"], row.get("benchmark")]
        named = isinstance(spec, dict) and all(row.get(name, of) == of for name, of in spec.items())
        if claimed != stated or not named:
            yield f"the row of {_named(row)} contradicts its key"


def _jobs(
    out: Path, result: RecordedResult, rows: Sequence[Row], cases: Cases, faults: list[str]
) -> Iterator[ReplayJob]:
    clock = parse_clock(result.clock)
    for row in rows:
        spec, digest = json.loads(row["key"])[3:5]
        path = actions_file(out, row["key"])
        try:
            data = read_regular(path)
            if hashlib.sha256(data).hexdigest() != row.get("actions"):
                raise ValueError("is not the one that was written")
            commands = unpack(data)
        except (OSError, ValueError) as error:
            faults.append(f"{path.name}: {error.__class__.__name__}: {error} ({_named(row)})")
            continue
        if (case := cases.get((spec, digest))) is not None:
            if waits := _other_waits(clock, commands):
                faults.append(f"{_named(row)}: {waits}")
            yield ReplayJob(case, clock, result, row, commands)


def _other_waits(clock: Clock, commands: Floats) -> str:
    if clock.kind == "measured" or not len(commands):
        return ""  # delays of a measured clock are in the actions
    wanted = clock.delay(0.0)
    waited = commands[0, 0] / PHYSICS_HZ
    # an overlapped answer waits for whole control periods
    if -0.003 <= waited - wanted <= (0.5 if clock.join else 0.003):
        return ""
    return f"the robot first waited {1000 * waited:.0f} ms; {clock.name} is {1000 * wanted:.0f} ms"


def carry_out_again(job: ReplayJob) -> dict[str, Any]:
    """The score of an episode that does what another did, with whether it began the same."""
    setup = job.result.read_setup()
    trial = Trial(job.case.scene(setup), job.clock.motion(job.case.target_motion), setup)
    same = start_of_trial(trial.simulation) == job.case.start
    try:
        trial.repeat(job.commands)
    except ActionError as error:
        return {"success": f"refused ({error})"}
    scored = asdict(score(trial))
    return json.loads(json.dumps(scored)) | {"same_start": same}
