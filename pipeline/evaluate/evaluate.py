"""An evaluation, whole: admit seeds, run the missing episodes, film some, summarise, write the
page."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from random import SystemRandom
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.atomic import exclusive, write_atomic
from pipeline.data.errors import check_directory
from pipeline.data.reading import check_plain
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.asking import PROMPT, introduce
from pipeline.evaluate.bundle import (
    RecordedResult,
    actions_file,
    hash_rows,
    hash_scenes,
    note_result,
    run_recorded,
)
from pipeline.evaluate.episode import EpisodeJob, start_of
from pipeline.evaluate.film import FilmJob, film, film_id, jpeg, read_strip, sheet
from pipeline.evaluate.names import is_built_in
from pipeline.evaluate.policies.policy import PolicyError, PolicyName, Start
from pipeline.evaluate.scenes.benchmark import Benchmark
from pipeline.evaluate.scenes.benchmark_rows import RecordedBenchmark
from pipeline.evaluate.scenes.case import BLIND, BenchmarkError, Case, blind, in_every_arm
from pipeline.evaluate.scenes.manifests import Manifests, Runner
from pipeline.evaluate.scoring.clock import Clock
from pipeline.evaluate.scoring.page import Film, caption, page
from pipeline.evaluate.scoring.results import EPISODES, Results, check_episode, text_key
from pipeline.evaluate.scoring.summary import Row, each_scene_once, over_tasks, summarise
from pipeline.evaluate.serving.client import ANSWER_SECONDS
from pipeline.world.robots import get_embodiment

BASELINES = ("static", "still")
"""Policies whose scores are printed beside others: one solves still scenes, one does nothing."""


@dataclass(frozen=True)
class Evaluation:
    """What is to be evaluated. `code` is the version of this program: results of another one do not
    count. The first `films` episodes of every cell are filmed. With `baselines`, BASELINES try the
    same scenes. Those of a `benchmark` are taken from it. `paired` runs every scene with and
    without its events, `conditions` with every set of them."""

    cells: tuple[Cell, ...]
    policy: PolicyName
    clock: Clock
    episodes: int = 100
    seed: int = 0
    setup: Setup = BLIND
    split: str = "unseen"
    compounding: bool = False
    code: str = ""
    films: int = 0
    answer_seconds: float = ANSWER_SECONDS
    baselines: bool = False
    paired: bool = False
    conditions: bool = False
    made_by: Mapping[str, Any] = field(default_factory=dict)
    benchmark: Benchmark | None = None


@dataclass(frozen=True)
class EvaluationResult:
    """A row for every cell, means over tasks, and means of BASELINES on the scenes that they tried.

    `run` is the number of episodes run by this call, `path` the file of all rows.
    """

    cells: list[Row]
    means: list[Row]
    baselines: list[Row]
    run: int
    path: Path
    page: Path
    benchmark: RecordedBenchmark | None = None

    @property
    def faults(self) -> dict[str, int]:
        """Why the policy gave no valid answer, the most frequent reason first, and in how many
        episodes."""
        return dict(
            sum((Counter(cell["faults"]) for cell in self.cells), Counter[str]()).most_common()
        )

    def to_dict(self) -> dict[str, Any]:
        values: dict[str, Any] = {"results": self.cells, "means": self.means}
        values["baselines"] = self.baselines
        if self.benchmark:
            values["benchmark"] = self.benchmark.model_dump()
        return values | {"run": self.run, "episodes": str(self.path), "page": str(self.page)}


def evaluate(
    evaluation: Evaluation,
    out: Path,
    run: Runner,
    manifests: Path | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> EvaluationResult:
    """Evaluate into OUT/episodes.jsonl, or resume; films go to OUT/films, the page to
    OUT/index.html, and manifests of seeds to `manifests`, by default OUT/manifests.

    The policy is loaded, and its contract compared, before any scene is admitted. Raises OSError
    for a file in place of a directory, ProtocolError, ResultsError, PolicyError if the policy
    cannot be made, refuses or differs from the one that made rows of this label, BenchmarkError for
    scenes that the benchmark does not have or rows of another one, and Busy if another evaluation
    writes to `out`.
    """
    # an alpha drawn for each episode: one layout at every speed would be the only one
    apart = len({cell.alpha for cell in evaluation.cells}) > evaluation.episodes
    seeds = Manifests(manifests or out / "manifests", evaluation.seed, evaluation.setup.calm, apart)
    for place in (out, seeds.root):
        check_directory(place)
        if place.exists():
            check_plain(place)
    frozen = None
    if evaluation.benchmark:
        frozen = evaluation.benchmark.cases(evaluation.cells, evaluation.episodes)
    for cell in () if frozen else evaluation.cells:
        seeds.read(cell)  # what is none is refused before anything is written
    evaluation = replace(evaluation, policy=_introduced(evaluation, run, tell))
    out.mkdir(parents=True, exist_ok=True)
    with exclusive(out):
        results = Results(out / EPISODES, check_episode)
        _check_identity(evaluation, results)
        tell("admitting seeds")
        admitted = frozen or seeds.admitted(evaluation.cells, evaluation.episodes, run)
        if evaluation.conditions:
            admitted = in_every_arm(admitted, len(evaluation.setup.events))
        beside = [_baseline(evaluation, name) for name in BASELINES]
        tried = [evaluation, *(beside if evaluation.baselines else ())]

        def jobs_of(each: Evaluation) -> list[list[EpisodeJob]]:
            return [[_job(each, case) for case in cases] for cases in admitted.values()]

        wanted = _unforeseen(chain(*map(jobs_of, tried)))
        missing = [job for job in wanted if text_key(job.key) not in results]
        if missing:
            for done, (job, (row, commands)) in enumerate(run(run_recorded, missing), 1):
                key = text_key(job.key)
                write_atomic(actions_file(out, key), commands)
                results.append(key, row)
                tell(f"{done} of {len(missing)} episodes")
        rows = results.of(text_key(job.key) for job in chain(*jobs_of(evaluation)))
        theirs = chain(*chain(*map(jobs_of, beside)))
        others = results.of(text_key(job.key) for job in theirs)
        for each in tried if any(admitted.values()) else ():
            note_result(out, _result(each, seeds, admitted, results))
        _film(evaluation, admitted, out, run, tell)
        page = _write_page(evaluation.code, results, out)
        means = over_tasks(rows), over_tasks(others)
        noted = evaluation.benchmark and evaluation.benchmark.record(len(rows))
        files = results.path, page
        return EvaluationResult(summarise(rows), *means, len(missing), *files, noted)


def _result(
    evaluation: Evaluation,
    seeds: Manifests,
    admitted: Mapping[Cell, Sequence[Case]],
    results: Results,
) -> RecordedResult:
    """What bundle.json states of an evaluation."""
    cases = [case for of_cell in admitted.values() for case in of_cell]
    return RecordedResult(
        code=evaluation.code,
        policy=evaluation.policy.label,
        probe=evaluation.policy.probe,
        clock=evaluation.clock.name,
        options=[*_job(evaluation, cases[0]).key[-1]],
        seed=seeds.seed,
        apart=seeds.apart,
        episodes=evaluation.episodes,
        cells=tuple(asdict(cell) for cell in evaluation.cells),
        scenes=hash_scenes(cases),
        rows=hash_rows(results.of(text_key(_job(evaluation, case).key) for case in cases)),
        made_by=dict(evaluation.made_by),
        benchmark=evaluation.benchmark and evaluation.benchmark.record(len(cases)),
    )


def _baseline(evaluation: Evaluation, name: str) -> Evaluation:
    """The same evaluation of a baseline."""
    policy = PolicyName(name, name, process="evaluator")
    return replace(evaluation, policy=policy, setup=blind(evaluation.setup), films=0)


def _check_identity(evaluation: Evaluation, results: Results) -> None:
    """Raise PolicyError for rows of this version and label by a policy that answered otherwise,
    BenchmarkError for rows of this version on another benchmark."""
    wanted = evaluation.benchmark.label if evaluation.benchmark else ""
    for row in results.rows():
        policy = evaluation.policy
        if json.loads(row["key"])[0] != evaluation.code:
            continue
        if (tried := row.get("benchmark", "")) != wanted:
            raise BenchmarkError(
                f"{results.path} holds episodes on {tried or 'no benchmark'}: give those on"
                f" {wanted or 'no benchmark'} another --out"
            )
        if row["policy"] == policy.label and row["probe"] != policy.probe:
            raise PolicyError(
                f"{results.path} holds episodes of another policy with the label {policy.label}:"
                " give this one another ?label= or --out"
            )


def _unforeseen(cells: Iterable[list[EpisodeJob]]) -> list[EpisodeJob]:
    """The episodes of one cell after another, in a cell in an order that nobody can know: a policy
    that counts its episodes learns nothing of their scenes. The order decides no number."""
    chance, out = SystemRandom(), list[EpisodeJob]()
    for jobs in cells:
        chance.shuffle(jobs)
        out += jobs
    return out


def _film(
    evaluation: Evaluation,
    admitted: Mapping[Cell, Sequence[Case]],
    out: Path,
    run: Runner,
    tell: Callable[[str], None],
) -> None:
    """Film the first episodes of every cell that have no film yet."""
    chosen = chain(*(cases[: evaluation.films] for cases in admitted.values()))
    jobs = [FilmJob(_job(evaluation, case), str(out / "films")) for case in chosen]
    missing = [job for job in jobs if not job.strip.exists()]
    for done, _ in enumerate(run(film, missing) if missing else (), 1):
        tell(f"{done} of {len(missing)} films")


def _write_page(code: str, results: Results, out: Path) -> Path:
    """The page of all rows of a version of the program with their films, and the contact sheet."""
    mine = [row for row in results.rows() if json.loads(row["key"])[0] == code]
    rows = each_scene_once(mine)
    rows.sort(key=lambda row: row["key"])
    films, strips = list[Film](), list[tuple[str, NDArray[np.uint8]]]()
    for row in rows:
        path = out / "films" / f"{film_id(row['key'])}.jpg"
        if path.exists():
            moving, said = path.with_suffix(".mp4"), caption(row)
            film = moving.read_bytes() if moving.exists() else b""
            films.append((said, path.read_bytes(), film))
            strips.append((said, read_strip(path)))
    if strips:
        write_atomic(out / "contact_sheet.jpg", jpeg(sheet(strips)))
    path = out / "index.html"
    benchmark = rows[0].get("benchmark", "") if rows else ""
    write_atomic(path, page(summarise(rows), over_tasks(rows), films, code, benchmark).encode())
    return path


def _job(evaluation: Evaluation, case: Case) -> EpisodeJob:
    names = ("policy", "clock", "code", "setup", "split", "compounding", "answer_seconds", "paired")
    label = evaluation.benchmark.label if evaluation.benchmark else ""
    given = {name: getattr(evaluation, name) for name in names}
    return EpisodeJob(case, **given, benchmark=label)


def _introduced(evaluation: Evaluation, run: Runner, tell: Callable[[str], None]) -> PolicyName:
    """The policy's name with its probe, asked where the policy runs. Raises PolicyError."""
    robots = dict.fromkeys(cell.embodiment for cell in evaluation.cells)
    starts = tuple(start_of(get_embodiment(robot), evaluation.setup, PROMPT) for robot in robots)
    job = (evaluation.policy, starts, evaluation.answer_seconds)
    if not starts or is_built_in(evaluation.policy):
        return introduce_policy(job)
    tell("loading the policy")
    return next(iter(run(introduce_policy, [job])))[1]


def introduce_policy(job: tuple[PolicyName, Sequence[Start], float]) -> PolicyName:
    """As `introduce`, for a runner."""
    return introduce(*job)
