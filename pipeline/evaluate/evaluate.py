"""An evaluation, from seeds to its page."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from random import SystemRandom
from typing import Any

from pipeline.data.atomic import exclusive, write_atomic
from pipeline.data.episode.frames import encode_mp4
from pipeline.data.errors import check_directory
from pipeline.data.reading import check_plain
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.world.robots import get_embodiment

from .asking import PROMPT, introduce
from .bundle import RecordedResult, actions_file, hash_rows, hash_scenes, note_result, run_recorded
from .episode import EpisodeJob, play, start_of
from .names import is_built_in
from .policies.policy import PolicyError, PolicyName
from .scenes.benchmark import Benchmark
from .scenes.benchmark_rows import RecordedBenchmark
from .scenes.case import BLIND, BenchmarkError, Case, in_every_arm
from .scenes.manifests import Manifests, Runner
from .scoring.clock import Clock
from .scoring.page import board_page, film_path
from .scoring.results import EPISODES, Results, check_episode, text_key
from .scoring.summary import Row, over_tasks, summarise
from .serving.client import ANSWER_SECONDS


@dataclass(frozen=True)
class Evaluation:
    """Results of another `code` do not count. The first `films` episodes of every cell are
    filmed. `paired` runs every scene with and without its events."""

    cells: tuple[Cell, ...]
    policy: PolicyName
    clock: Clock
    episodes: int = 100
    seed: int = 0
    setup: Setup = BLIND
    split: str = "unseen"
    code: str = ""
    films: int = 0
    answer_seconds: float = ANSWER_SECONDS
    paired: bool = False
    conditions: bool = False
    made_by: Mapping[str, Any] = field(default_factory=dict)
    benchmark: Benchmark | None = None


@dataclass(frozen=True)
class EvaluationResult:
    """A row for every cell, and means over tasks; `run` episodes were run by this call."""

    cells: list[Row]
    means: list[Row]
    run: int
    path: Path
    page: Path
    benchmark: RecordedBenchmark | None = None

    @property
    def faults(self) -> dict[str, int]:
        counts = sum((Counter(cell["faults"]) for cell in self.cells), Counter[str]())
        return dict(counts.most_common())

    def to_dict(self) -> dict[str, Any]:
        values: dict[str, Any] = {"results": self.cells, "means": self.means, "run": self.run}
        if self.benchmark:
            values["benchmark"] = self.benchmark.model_dump()
        return values | {"episodes": str(self.path), "page": str(self.page)}


def evaluate(
    evaluation: Evaluation,
    out: Path,
    run: Runner,
    manifests: Path | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> EvaluationResult:
    """Evaluate into OUT/episodes.jsonl, or resume. Raises OSError, ProtocolError, ResultsError,
    BenchmarkError, PolicyError (also for the label of another policy), and Busy."""
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
        if not frozen:
            tell("admitting seeds")
        admitted = frozen or seeds.admitted(evaluation.cells, evaluation.episodes, run)
        if evaluation.conditions:
            admitted = in_every_arm(admitted, len(evaluation.setup.events))
        wanted = [[_job(evaluation, case) for case in cases] for cases in admitted.values()]
        missing = list[EpisodeJob]()
        for jobs in wanted:
            left = [job for job in jobs if text_key(job.key) not in results]
            SystemRandom().shuffle(left)  # a policy that counts episodes learns nothing
            missing += left
        ends = run(run_recorded, missing) if missing else ()
        for done, (job, (row, commands)) in enumerate(ends, 1):
            key = text_key(job.key)
            write_atomic(actions_file(out, key), commands)
            results.append(key, row)
            tell(f"{done} of {len(missing)} episodes")
        rows = results.of(text_key(job.key) for job in chain(*wanted))
        if rows:
            note_result(out, _result(evaluation, seeds, admitted, rows))
        _film(evaluation, admitted, out, run, tell)
        page = _write_page(evaluation.code, results, out)
        noted = evaluation.benchmark and evaluation.benchmark.record(len(rows))
        run_now, files = len(missing), (results.path, page)
        return EvaluationResult(summarise(rows), over_tasks(rows), run_now, *files, noted)


def together(outcomes: Iterable[EvaluationResult]) -> EvaluationResult:
    each = [*outcomes]
    rows = {n: [row for one in each for row in getattr(one, n)] for n in ("cells", "means")}
    return replace(each[-1], **rows, run=sum(one.run for one in each))


def _result(
    evaluation: Evaluation,
    seeds: Manifests,
    admitted: Mapping[Cell, Sequence[Case]],
    rows: Sequence[Row],
) -> RecordedResult:
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
        rows=hash_rows(rows),
        made_by=dict(evaluation.made_by),
        benchmark=evaluation.benchmark and evaluation.benchmark.record(len(cases)),
    )


def _check_identity(evaluation: Evaluation, results: Results) -> None:
    wanted = evaluation.benchmark.label if evaluation.benchmark else ""
    for row in results.rows():
        policy = evaluation.policy
        if json.loads(row["key"])[0] != evaluation.code:
            continue
        if (tried := row.get("benchmark", "")) != wanted:
            both = f"on {tried or 'no benchmark'}, not on {wanted or 'no benchmark'}"
            raise BenchmarkError(f"{results.path} holds episodes {both}: give another --out")
        if row["policy"] == policy.label and row["probe"] != policy.probe:
            what = f"episodes of another policy with the label {policy.label}"
            raise PolicyError(f"{results.path} holds {what}: give another ?label= or --out")


def _film(
    evaluation: Evaluation,
    admitted: Mapping[Cell, Sequence[Case]],
    out: Path,
    run: Runner,
    tell: Callable[[str], None],
) -> None:
    chosen = chain(*(cases[: evaluation.films] for cases in admitted.values()))
    jobs = [FilmJob(_job(evaluation, case), str(out)) for case in chosen]
    missing = [job for job in jobs if not job.path.exists()]
    for done, _ in enumerate(run(film, missing) if missing else (), 1):
        tell(f"{done} of {len(missing)} films")


def _write_page(code: str, results: Results, out: Path) -> Path:
    rows = [row for row in results.rows() if json.loads(row["key"])[0] == code]
    write_atomic(path := out / "index.html", board_page({out: rows}).encode())
    return path


def _job(evaluation: Evaluation, case: Case) -> EpisodeJob:
    names = ("policy", "clock", "code", "setup", "split", "answer_seconds", "paired")
    label = evaluation.benchmark.label if evaluation.benchmark else ""
    given = {name: getattr(evaluation, name) for name in names}
    return EpisodeJob(case, **given, benchmark=label)


def _introduced(evaluation: Evaluation, run: Runner, tell: Callable[[str], None]) -> PolicyName:
    robots = dict.fromkeys(cell.embodiment for cell in evaluation.cells)
    starts = [start_of(get_embodiment(robot), evaluation.setup, PROMPT) for robot in robots]
    job = (evaluation.policy, starts, evaluation.answer_seconds)
    if not starts or is_built_in(evaluation.policy):
        return introduce(*job)
    tell("loading the policy")
    return next(iter(run(lambda given: introduce(*given), [job])))[1]


@dataclass(frozen=True)
class FilmJob:
    """Films into OUT/films. Workers must share the file system."""

    episode: EpisodeJob
    out: str

    @property
    def path(self) -> Path:
        return film_path(Path(self.out), text_key(self.episode.key))


def film(job: FilmJob) -> None:
    trial, _ = play(job.episode)
    appearance = appearance_of(
        trial.scene, Setup(camera=job.episode.setup.camera, cameras=("head",))
    )
    write_atomic(job.path, encode_mp4(render(appearance, trial.log())[0].rgb, trial.fps))
