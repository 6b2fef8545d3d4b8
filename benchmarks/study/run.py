"""Runs the study into DIR/rows.jsonl, a few seeds of everything at a time, so that it can be
stopped whenever one likes."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.hardware import hardware
from benchmarks.study.plan import StudyGroup
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scenes.case import blind
from pipeline.evaluate.scenes.manifests import Manifests, ProtocolError, inline
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.results import Results, text_key
from pipeline.run.evaluation import evaluation_version


def run(where: Path, groups: Sequence[StudyGroup], seeds: int, step: int = 2) -> None:
    """Run what is missing: `seeds` admitted scenes of every group, `step` of all of them before the
    next ones.

    Rows say by which version of the code and on which hardware they were made; rows of another
    version are run again.
    """
    results, version = Results(where / "rows.jsonl"), evaluation_version()
    for upto in range(step, seeds + step, step):
        for group in groups:
            _group(group, min(upto, seeds), where, results, version)
        print(f"{min(upto, seeds)} seeds: {hardware()}", flush=True)


def _group(group: StudyGroup, seeds: int, where: Path, results: Results, version: str) -> None:
    manifests = Manifests(where / "manifests" / version[:12], setup=group.setup)
    try:
        cases = manifests.admitted([group.cell], seeds, inline)[group.cell]
    except ProtocolError as error:
        print(error, flush=True)
        cases = manifests.read(group.cell).cases[:seeds]
    for case in cases:
        for policy, clock in group.tries:
            job = EpisodeJob(
                case, policy_name(policy), parse_clock(clock), version, blind(group.setup)
            )
            if text_key(job.key) not in results:
                results.append(
                    text_key(job.key),
                    run_episode(job) | {"version": version[:12], "hardware": hardware()},
                )
