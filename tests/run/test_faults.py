"""A build whose workers are killed ends by itself; a seed whose workers are killed or hang is
recorded and the next is tried."""

import json
import os
import signal
import threading
from pathlib import Path

import pytest

from pipeline.crew.contract import Crew, Steps
from pipeline.data.atomic import temporary_name
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Recipe
from pipeline.data.slots.records import SlotRecord
from pipeline.run import build as build_module
from pipeline.run.names import recipe_from
from pipeline.run.slot import fill as slot
from pipeline.run.slot.fill import FillJob, LostAttempt, fill_in_steps, fill_slot
from pipeline.stages.failure import Failure
from tests.run.command import PATIENCE, WANTED, contents, slots, start, temporaries
from tests.run.processes import of_session, shared_memory, title, wait_for, workers

RECIPE = recipe_from(
    {"tasks": "click_bell", "embodiments": "aloha", "levels": [1], "episodes": 3, "attempts": 4}
)


# --- the slot
# ------------------------------------------------------------------------------------------


def failing(spec, _recipe, _perform=None):
    """An attempt that fails in the dry run, as most do that fail."""
    raise Failure("dry_run", "no_path")


def seeds(recipe: Recipe) -> list[list[int]]:
    """Seeds of the attempts at each slot."""
    return [
        [recipe.spec(one, number).seed for number in range(recipe.attempts)]
        for one in recipe.slots()
    ]


def fatal_fill_slot(job: FillJob) -> Steps[SlotRecord]:
    """Fill a slot where seeds fail; the second seed of slot 0 kills its worker in the middle of
    writing an asset, always, and the first of slot 1 kills it once."""
    told = seeds(job.recipe)
    once = Path(job.root) / "killed-once"

    def attempt(spec, recipe, perform):
        if spec.seed == told[0][1]:
            half = temporary_name(Path(job.root) / "assets" / "bodies" / "aa" / "body.npz")
            half.parent.mkdir(parents=True, exist_ok=True)
            half.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if spec.seed == told[1][0] and not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        failing(spec, recipe)

    slot.attempt = attempt
    return fill_in_steps(job)


@pytest.mark.usefixtures("ray_session")
def test_a_seed_that_takes_two_workers_is_recorded_and_the_next_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(build_module, "fill_in_steps", fatal_fill_slot)
    results = []
    # as from a notebook or a web page: Python has signal handlers in the main thread only
    arguments = tmp_path / "out", RECIPE, Crew("ray", 2), 600.0, "none"
    thread = threading.Thread(target=lambda: results.append(build_module.build(*arguments)))
    thread.start()
    thread.join()
    (result,) = results
    assert (result.slots, result.accepted, result.given_up, result.attempts) == (3, 0, 3, 12)
    assert result.workers_lost == 3
    assert result.reasons == {"no_path": 11, "worker_died": 1}
    dataset = Dataset(tmp_path / "out")
    assert not temporaries(dataset.root)
    for one, its_seeds in zip(RECIPE.slots(), seeds(RECIPE), strict=True):
        record = dataset.record(RECIPE, one)
        assert record is not None
        rows = record.attempts
        assert [row["seed"] for row in rows] == its_seeds
        for number, row in enumerate(rows):
            died = (one.index, number) == (0, 1)
            assert (row["stage"], row["reason"]) == (
                ("worker", "worker_died") if died else ("dry_run", "no_path")
            )
            assert row["outcome"] == "failed"
        logged = dataset.log(one).read_text()
        assert all(
            f"attempt {row['attempt']}, seed {row['seed']}: {row['stage']}: {row['reason']}"
            in logged
            for row in rows
        )


def test_lost_attempts_are_recorded_and_not_tried(tmp_path, monkeypatch):
    tried = []

    def attempt(spec, recipe, perform):
        tried.append(spec.seed)
        failing(spec, recipe)

    monkeypatch.setattr(slot, "attempt", attempt)
    (one, *_), (its_seeds, *_) = RECIPE.slots(), seeds(RECIPE)
    lost = (LostAttempt(2, "worker_hung", 60.0), LostAttempt(0, "worker_died", 1.5))
    record = fill_slot(FillJob(str(tmp_path), RECIPE, one, lost=lost))
    assert tried == [its_seeds[1], its_seeds[3]]
    assert [(row["attempt"], row["stage"], row["reason"]) for row in record.attempts] == [
        (0, "worker", "worker_died"),
        (1, "dry_run", "no_path"),
        (2, "worker", "worker_hung"),
        (3, "dry_run", "no_path"),
    ]
    assert [record.attempts[number]["seconds"] for number in (0, 2)] == [1.5, 60.0]
    assert not record.accepted


def test_what_a_killed_worker_left_half_written_of_a_slot_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(slot, "attempt", failing)
    dataset, (one, other, _) = Dataset(tmp_path), RECIPE.slots()
    path = dataset.episode(one)
    path.parent.mkdir(parents=True)
    half = path.with_name(f".{path.name}.another-machine.123.tmp")
    others = dataset.episode(other).with_name(
        f".{dataset.episode(other).name}.another-machine.123.tmp"
    )
    for file in (half, others):
        file.touch()
    fill_slot(FillJob(str(tmp_path), RECIPE, one))
    assert (half.exists(), others.exists()) == (False, True)


# --- the whole build
# ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_build_outlives_killed_workers_with_the_same_bytes(built, tmp_path):
    out = tmp_path / "out"
    options = ("--quiet", "--json", "--executor", "ray", "--workers", 2)
    shared = shared_memory()
    process = start("build", *WANTED, "--out", out, *options, new_session=True)

    def at_work() -> list[int]:
        return [
            pid
            for pid in workers(of_session(process.pid))
            if title(pid).endswith((".start", ".go_on"))
        ]

    def both_held() -> bool:
        """Whether both workers are stopped in the middle of a job: one that ends it first continues
        and is waited for again."""
        found = at_work()
        for worker in found:
            os.kill(worker, signal.SIGSTOP)
        if len(found) == 2 and at_work() == found:
            return True
        for worker in found:
            os.kill(worker, signal.SIGCONT)
        return False

    assert wait_for(both_held, 180)
    for worker in at_work():
        os.kill(worker, signal.SIGKILL)
    printed, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    result = json.loads(printed)
    assert (result["accepted"], result["made"], result["workers_lost"]) == (3, 3, 2)
    assert contents(out) == contents(built)
    assert len(slots(out)) == 3
    assert not temporaries(out)
    assert not of_session(process.pid)
    assert wait_for(lambda: shared_memory() <= shared)
