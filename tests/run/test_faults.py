"""A build whose workers are killed ends by itself; a seed whose workers are killed or hang is recorded and the next is tried."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.crew.pool import Limit, Pool
from pipeline.data.atomic import temporary_name
from pipeline.data.dataset import Dataset
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.recipe.model import Recipe
from pipeline.run import build as build_module
from pipeline.run.identity.slot_keys import code_version
from pipeline.run.names import recipe_from
from pipeline.run.slot import fill as slot
from pipeline.run.slot import running
from pipeline.run.slot.fill import Lost, SlotJob, fill_logged, fill_slot, slot_worker
from pipeline.stages.failure import Failure
from tests.run.command import PATIENCE, WANTED, contents, slots, start, temporaries
from tests.run.processes import of_session, shared_memory, title, wait_for, workers
from tests.synthetic import make_episode

RECIPE = recipe_from({"tasks": "click_bell", "embodiments": "aloha", "levels": [1], "episodes": 3, "attempts": 4})
PATIENT, HUNG = 20.0, 1.0
"""Seconds after which a worker counts as hung: one that works on a busy machine, and one that is stopped."""


# --- the slot ---------------------------------------------------------------------------------------------------------------


def failing(spec, _recipe, _phases):
    """An attempt that fails in the dry run, as most do that fail."""
    raise Failure("dry_run", "no_path")


def seeds(recipe: Recipe) -> list[list[int]]:
    """Seeds of the attempts at each slot."""
    return [[recipe.spec(one, number).seed for number in range(recipe.attempts)] for one in recipe.slots()]


def fatal_fill_slot(job: SlotJob) -> SlotRecord:
    """Fill a slot where seeds fail, but the second seed of slot 0 kills its worker in the middle of writing an asset, always; the
    third of slot 1 stops it, always; and the first of slot 2 kills it once."""
    told = seeds(job.recipe)
    once = Path(job.root) / "killed-once"

    def attempt(spec, recipe, phases, perform):
        if spec.seed == told[0][1]:
            half = temporary_name(Path(job.root) / "assets" / "bodies" / "aa" / "body.npz")
            half.parent.mkdir(parents=True, exist_ok=True)
            half.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if spec.seed == told[1][2]:
            (Path(job.root) / "stopped").write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGSTOP)
        if spec.seed == told[2][0] and not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        failing(spec, recipe, phases)

    slot.attempt = attempt
    return fill_logged(job)


def fatal_worker() -> Callable[[SlotJob], SlotRecord]:
    slot_worker()
    return fatal_fill_slot


class StateLimit:
    """In place of `Limit`: short for a worker that `fatal_fill_slot` has stopped, so that none is taken for one that is slow."""

    def __init__(self, mark: Path):
        self.mark = mark

    def __getitem__(self, _):
        return lambda _, headway: Limit(lambda _: HUNG if self.is_stopped() else PATIENT, headway)

    def is_stopped(self) -> bool:
        try:
            return "State:\tT" in Path(f"/proc/{self.mark.read_text()}/status").read_text()
        except FileNotFoundError:
            return False


@pytest.mark.usefixtures("ray_session")
def test_a_seed_that_takes_two_workers_is_recorded_and_the_next_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(build_module, "slot_worker", fatal_worker)
    monkeypatch.setattr(build_module, "Limit", StateLimit(tmp_path / "out" / "stopped"))
    result = build_module.build(tmp_path / "out", RECIPE, Pool("ray", 2), shown="none")
    assert (result.slots, result.accepted, result.given_up, result.attempts) == (3, 0, 3, 12)
    assert result.workers_lost == 5
    assert result.reasons == {"no_path": 10, "worker_died": 1, "worker_hung": 1}
    dataset = Dataset(tmp_path / "out")
    assert not temporaries(dataset.root)
    died = {(0, 1): "worker_died", (1, 2): "worker_hung"}
    for one, its_seeds in zip(RECIPE.slots(), seeds(RECIPE), strict=True):
        record = dataset.record(one)
        assert record is not None
        rows = record.attempts
        assert [row["seed"] for row in rows] == its_seeds
        for number, row in enumerate(rows):
            reason = died.get((one.index, number))
            assert (row["stage"], row["reason"]) == (("worker", reason) if reason else ("dry_run", "no_path"))
            assert row["outcome"] == "failed"
            assert row["seconds"] >= (HUNG if reason == "worker_hung" else 0.0)
        assert running.read_note(dataset, one) is None
        logged = dataset.log(one).read_text()
        assert all(f"attempt {row['attempt']}, seed {row['seed']}: {row['stage']}: {row['reason']}" in logged for row in rows)


def test_an_episode_whose_entry_did_not_come_is_removed(tmp_path, monkeypatch):
    def stopped(job: SlotJob) -> SlotRecord:
        make_episode(Dataset(Path(job.root)).episode(job.slot), frames=2)
        raise KeyboardInterrupt

    monkeypatch.setattr(build_module, "slot_worker", lambda: stopped)
    with pytest.raises(KeyboardInterrupt):
        build_module.build(tmp_path / "out", RECIPE, Pool(), shown="none")
    assert not list(tmp_path.rglob("*.hdf5"))


def test_lost_attempts_are_recorded_and_not_tried(tmp_path, monkeypatch):
    tried = []

    def attempt(spec, recipe, phases, perform):
        tried.append(spec.seed)
        failing(spec, recipe, phases)

    monkeypatch.setattr(slot, "attempt", attempt)
    (one, *_), (its_seeds, *_) = RECIPE.slots(), seeds(RECIPE)
    lost = (Lost(2, "worker_hung", 60.0), Lost(0, "worker_died", 1.5))
    record = fill_slot(SlotJob(str(tmp_path), RECIPE, one, code_version(), lost=lost))
    assert tried == [its_seeds[1], its_seeds[3]]
    assert [(row["attempt"], row["stage"], row["reason"]) for row in record.attempts] == [
        (0, "worker", "worker_died"),
        (1, "dry_run", "no_path"),
        (2, "worker", "worker_hung"),
        (3, "dry_run", "no_path"),
    ]
    assert [record.attempts[number]["seconds"] for number in (0, 2)] == [1.5, 60.0]
    assert not record.accepted


def test_a_note_outlives_its_writer_and_clearing_removes_what_was_half_written(tmp_path):
    dataset, (one, other, _) = Dataset(tmp_path), RECIPE.slots()
    assert running.read_note(dataset, one) is None
    running.note(dataset, one, 7)
    noted = running.read_note(dataset, one)
    assert noted is not None and noted[0] == 7
    path = dataset.episode(one)
    path.parent.mkdir(parents=True)
    half = path.with_name(f".{path.name}.123.tmp")
    others = dataset.episode(other).with_name(f".{dataset.episode(other).name}.123.tmp")
    for file in (half, others, path):
        file.touch()
    running.clear_all(dataset, list(RECIPE.slots()))
    # a slot without a note may be another machine's
    assert [file.exists() for file in (half, others, path)] == [False, True, True]
    assert running.read_note(dataset, one) is None


# --- the whole build --------------------------------------------------------------------------------------------------------


def test_a_build_outlives_killed_workers_with_the_same_bytes(built, tmp_path):
    out = tmp_path / "out"
    options = ("--quiet", "--json", "--executor", "ray", "--workers", 2)
    shared = shared_memory()
    process = start("build", *WANTED, "--out", out, *options, new_session=True)

    def at_work() -> list[int]:
        return [pid for pid in workers(of_session(process.pid)) if title(pid).endswith(".do")]

    def attempts() -> list[Path]:
        return list(out.glob("ledger/**/*.running"))

    wait_for(lambda: len(attempts()) == 2 and len(at_work()) == 2, 180)
    for worker in at_work():
        os.kill(worker, signal.SIGKILL)
    printed, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    result = json.loads(printed)
    assert (result["accepted"], result["made"], result["workers_lost"]) == (3, 3, 2)
    assert contents(out) == contents(built)
    assert len(slots(out)) == 3
    assert not temporaries(out)
    assert not attempts()
    assert not of_session(process.pid)
    assert wait_for(lambda: shared_memory() <= shared)
