"""Failed attempts that are kept: what their files say, where they are, and that nothing takes them
for episodes."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.intact import intact_episodes, intact_failures, kept_failures
from pipeline.data.slots.reread import IndexWriter
from pipeline.export import EXPORTERS, Job
from pipeline.export.shared.episodes import FAILURES, ExportError
from pipeline.motion.models import motion_from_json
from pipeline.run.checks.verify import verify
from pipeline.run.names import recipe_from
from pipeline.run.slot.fill import FillJob, fill_slot
from pipeline.run.state import DONE, GONE, IMAGES, PHYSICS, SlotState, missing, states
from pipeline.tasks import TASKS
from tests.export.running import check_export
from tests.recording import record_all
from tests.synthetic import make_episode

WANTED = {
    "tasks": ["click_bell"],
    "embodiments": ["aloha-agilex"],
    "levels": [1],
    "episodes": 1,
    "attempts": 1,
}
SMALL = {"size": [32, 24], "cameras": ["head"], "instructions": 2, "render": "raster-fast"}


def fill(root, **changes):
    recipe = recipe_from(WANTED | SMALL | changes)
    dataset = Dataset(root)
    dataset.create(recipe)
    slot = next(recipe.slots())
    record = fill_slot(FillJob(str(root), recipe, slot))
    record_all(dataset, [(slot, record)])
    return dataset, recipe, record


@pytest.fixture(scope="module")
def moving():
    """click_bell with a condition that holds for a bell that stands still: dry runs succeed and
    replays fail."""
    with pytest.MonkeyPatch.context() as patch:
        task = type(TASKS["click_bell"])
        success = task.success

        def also_still(self, o, arms):
            return success(self, o, arms) | {
                "stood_still": float(np.ptp(o.log.pose("bell")[:, :2], axis=0).max()) < 0.01
            }

        patch.setattr(task, "success", also_still)
        yield


@pytest.fixture(scope="module")
def failed(tmp_path_factory, moving):
    return fill(tmp_path_factory.mktemp("failed") / "out", keep_failures="rendered")


def test_a_failed_replay_is_a_file_that_says_why(failed):
    dataset, recipe, record = failed
    (row,) = record.attempts
    assert not record.accepted and (row["stage"], row["reason"], row["conditions"]) == (
        "replay",
        "no_success",
        ["stood_still"],
    )
    ((_, path, kept),) = kept_failures(dataset, recipe)
    assert kept == row["kept"] and path == dataset.failure(next(recipe.slots()), 0)
    with EpisodeFile(path) as file:
        episode, why = file.read(), file.meta.failure
        image = file.rgb("head_camera", len(file) // 2)
    assert why is not None and (why.attempt, why.stage, why.reason) == (0, "replay", "no_success")
    assert why.conditions == ("stood_still",) and episode.log.event("success") is None
    holds = episode.interception["conditions/stood_still"]
    assert holds[0] and not holds[-1] and image.std() > 5
    # the target is on the motion that the file names until it is touched
    log, motion = episode.log, motion_from_json(episode.motion)
    before = log.times < (log.time_of("release") or np.inf)
    np.testing.assert_allclose(
        log.pose("bell")[before, :3], motion.position(log.times[before]), atol=1e-3
    )


def test_nothing_takes_it_for_an_episode(failed, tmp_path):
    dataset, recipe, _ = failed
    assert dataset.accepted(recipe) == intact_episodes(dataset, recipe) == []
    assert len(intact_failures(dataset, recipe)) == 1
    assert not list(dataset.episodes.rglob("*.hdf5"))
    why = {"attempt": 0, "stage": "replay", "reason": "no_success"}
    mixed = [
        make_episode(tmp_path / f"{n}.hdf5", frames=4, meta=meta)
        for n, meta in enumerate(({}, {"failure": why}))
    ]
    exporter = EXPORTERS["puma-gt"]
    with pytest.raises(ExportError, match="failed True differs from False"):
        exporter.export(Job(tmp_path, tmp_path / "mixed", mixed, exporter.options()))


def test_an_export_of_failures_says_so_and_is_compared_with_them(failed, tmp_path):
    dataset, recipe, _ = failed
    copy = Dataset(tmp_path / "copy")
    shutil.copytree(dataset.root, copy.root)
    exporter, place = EXPORTERS["parquet"], copy.exports("parquet-failures")
    job = Job(copy.root, place, intact_failures(copy, recipe), exporter.options(), split=FAILURES)
    assert exporter.export(job)["split"] == FAILURES
    (row,) = pq.read_table(place / "episodes.parquet").to_pylist()
    assert '"stood_still"' in row["failure"] and row["t_success"] is None
    assert check_export(copy.root, place, intact_failures(copy, recipe)) == []


def test_damage_and_strays_are_found(failed, tmp_path):
    dataset, recipe, _ = failed
    copy = Dataset(tmp_path / "copy")
    shutil.copytree(dataset.root, copy.root)
    assert verify(copy)["problems"] == []
    ((_, path, _),) = kept_failures(copy, recipe)
    shutil.copy(path, path.with_name("episode_0000000_attempt_007.hdf5"))
    assert any(
        "attempt_007.hdf5: belongs to no slot" in problem for problem in verify(copy)["problems"]
    )
    with path.open("r+b") as file:
        file.seek(-1, 2)
        file.write(b"\1")
    name = path.relative_to(copy.root).as_posix()
    assert any(
        problem.startswith(f"{name}: its bytes are not") for problem in verify(copy)["problems"]
    )
    with pytest.raises(DatasetError, match="sha256"):
        intact_failures(copy, recipe)


def test_other_images_of_a_slot_that_was_given_up_are_those_of_its_failures(failed):
    dataset, recipe, _ = failed
    assert [state for _, state in states(dataset, recipe)] == [SlotState(DONE, (), False)]
    changed = recipe.model_copy(update={"size": (40, 24)})
    assert [state for _, state in states(dataset, changed)] == [
        SlotState(IMAGES, ("recipe",), False)
    ]


def test_the_bytes_are_those_of_the_slot_whoever_fills_it(failed, tmp_path):
    _, _, record = failed
    again = fill(tmp_path / "again", keep_failures="rendered")[2]
    assert again.attempts[0]["kept"] == record.attempts[0]["kept"]


def test_dry_runs_are_kept_only_where_all_are(tmp_path, monkeypatch):
    task = type(TASKS["click_bell"])
    success = task.success
    monkeypatch.setattr(
        task, "success", lambda self, o, arms: success(self, o, arms) | {"heard": False}
    )
    dataset, recipe, record = fill(tmp_path / "rendered", keep_failures="rendered")
    assert record.attempts[0]["stage"] == "dry_run" and not list(kept_failures(dataset, recipe))
    dataset, recipe, _ = fill(tmp_path / "all", keep_failures="all")
    ((_, path, _),) = kept_failures(dataset, recipe)
    with EpisodeFile(path) as file:
        episode = file.read()
    assert episode.meta.failure is not None and episode.meta.failure.stage == "dry_run"
    # a dry run is not passed off as a moving target
    assert (
        episode.meta.maximum_speed == 0.0
        and np.ptp(episode.log.pose("bell")[:20, :3], axis=0).max() < 1e-4
    )


def test_what_is_said_of_a_damaged_one_helps(failed, tmp_path):
    """A slot that was given up has no episode that could be removed."""
    dataset, recipe, _ = failed
    copy, slot = Dataset(tmp_path / "copy"), next(recipe.slots())
    shutil.copytree(dataset.root, copy.root)
    ((_, path, sha256),) = kept_failures(copy, recipe)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.raises(DatasetError, match="remove it, if it is there, and run the build again"):
        intact_failures(copy, recipe)
    with IndexWriter(copy, recipe) as writer:
        assert missing(copy, recipe, writer) == {}
        path.unlink()
        assert missing(copy, recipe, writer) == {slot: SlotState(PHYSICS, (GONE,), False)}
    with pytest.raises(DatasetError, match="remove it, if it is there, and run the build again"):
        intact_failures(copy, recipe)
    again = fill_slot(FillJob(str(copy.root), recipe, slot))
    assert path.read_bytes() == whole and again.attempts[0]["kept"] == sha256
    assert intact_failures(copy, recipe) == [path]
