"""`domino-data render` on a real dataset: the stored frames again, other looks and sensors,
interruptions, workers, bad input."""

import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from filelock import FileLock

from benchmarks.filming import facing, film
from pipeline.crew.contract import Crew
from pipeline.data.cameras import CameraType, visible
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.state_log import physics_id
from pipeline.data.keys import SEAL, file_hash, seal_yaml
from pipeline.data.setup.brought import read_unchanged
from pipeline.run import render as drawing
from pipeline.run.build import build
from pipeline.run.checks.verify import verify
from pipeline.run.names import recipe_from
from pipeline.run.render import render
from pipeline.run.slot import redraw
from pipeline.run.state import status
from tests.export.running import run as run_export
from tests.recording import record_all
from tests.run.command import PATIENCE, inside, slots, start, wait_for_a_slot

DRAWN = {"render": "raster-fast", "size": [160, 120]}
RECIPE = {
    "tasks": "click_bell",
    "embodiments": "aloha-agilex",
    "levels": [1, 2],
    "episodes": 1,
} | DRAWN
SENSORS = "noise=2,drift=0.1,latency=0.5"
SMALL = {"size": (64, 48), "cameras": ["head"], "visuals": "randomized", "sensors": SENSORS}
pytestmark = pytest.mark.usefixtures("without_report")


@pytest.fixture(scope="session")
def source(tmp_path_factory, worker_id):
    """Two built episodes, made once for all test processes; nobody writes to it."""
    base = tmp_path_factory.getbasetemp()
    shared = (base if worker_id == "master" else base.parent) / "drawn-once"
    with FileLock(f"{shared}.lock"):
        if not (shared / "report" / "index.html").exists():
            build(shared, recipe_from(RECIPE), Crew(), shown="none")
    return Dataset(shared)


@pytest.fixture
def mine(source, tmp_path):
    """A copy to write to."""
    return Dataset(Path(shutil.copytree(source.root, tmp_path / "mine")))


def draw(source, out, **changes):
    return render(source, out, changes, Crew(), quiet=True)


def files(dataset, *patterns):
    """Bytes by path of everything that must not depend on who drew it or how often it was
    stopped."""
    patterns = patterns or ("episodes/**/*.hdf5", "assets/**/*.npz", "manifest.yaml")
    return {
        p.relative_to(dataset.root).as_posix(): p.read_bytes()
        for pattern in patterns
        for p in dataset.root.glob(pattern)
    }


def failed(dataset):
    return verify(dataset)["problems"]


def paths(dataset):
    return dataset.accepted(dataset.recipe())


# --- what is drawn
# ------------------------------------------------------------------------------------------


def test_a_film_has_every_frame_and_both_arms_and_the_path_in_view(source, monkeypatch):
    kind = CameraType(64, 48, 40.0)
    monkeypatch.setattr("benchmarks.filming.FILMED", kind)
    path, *_ = paths(source)
    with EpisodeFile(path) as file:
        episode = file.read()
    outside, head = film(path, source.assets / "bodies", "head_camera")
    assert outside.rgb.shape == head.rgb.shape == (len(episode.log), 48, 64, 3)
    assert outside.rgb.std() > 10 and head.rgb.std() > 10
    camera = facing(episode.log, episode.meta.target)
    seen = [
        name
        for name in episode.log.bodies
        if name.startswith(("left_", "right_")) or name == episode.meta.target
    ]
    assert len(seen) > 12
    assert all(
        visible(kind, camera.pose, episode.log.pose(name)[:, :3], margin=4).all() for name in seen
    )


def test_stored_looks_are_drawn_again_byte_for_byte(source, tmp_path):
    out = Dataset(tmp_path / "out")
    result = draw(source, out)
    assert (result.slots, result.accepted, result.drawn, result.open, result.problems) == (
        2,
        2,
        2,
        0,
        (),
    )
    assert files(out) == files(source)
    assert failed(out) == []
    before = {p: p.stat().st_mtime_ns for p in out.episodes.rglob("*.hdf5")}
    again = draw(source, out)
    assert (again.drawn, again.accepted) == (0, 2)
    assert {p: p.stat().st_mtime_ns for p in out.episodes.rglob("*.hdf5")} == before
    assert json.loads(out.provenance.read_text())["drawn_from"] == json.loads(
        source.provenance.read_text()
    )


def test_other_sensors_and_cameras_are_those_of_a_build_that_wants_them(source, tmp_path):
    corner = {
        "name": "corner",
        "pose": [0.9, 0.2, 1.3, 0, 0, 0, 1],
        "width": 100,
        "height": 60,
        "fovy": 70.0,
    }
    wrist = {
        "name": "finger",
        "link": "left_link6",
        "pose": [0.1, 0, 0, 1, 0, 0, 0],
        "width": 32,
        "height": 32,
        "fovy": 60.0,
    }
    changes = {
        "depth": True,
        "segmentation": True,
        "pointcloud": True,
        "cameras": ["observer", "head", corner, wrist],
    }
    out, built = Dataset(tmp_path / "out"), Dataset(tmp_path / "built")
    draw(source, out, **changes)
    build(built.root, recipe_from(RECIPE | changes | {"levels": [2]}), Crew(), shown="none")
    assert files(out, "episodes/**/L2/**/*.hdf5") == files(built, "episodes/**/*.hdf5") != {}
    assert failed(out) == []
    for path, plain in zip(paths(out), paths(source), strict=True):
        with EpisodeFile(path) as e, EpisodeFile(plain) as s:
            assert e.cameras == ("corner", "finger", "head_camera", "observer_camera")
            np.testing.assert_array_equal(
                e.array("observation/head_camera/rgb"), s.array("observation/head_camera/rgb")
            )
            # the recipe's size is that of every camera
            assert e.array("observation/corner/depth").shape == (len(e), 120, 160)
            bell = e.read().log.bodies.index("bell")
            assert (e.array("observation/observer_camera/actor_segmentation") == bell + 1).any()
            cloud = e.array("pointcloud")
            assert cloud.shape == (len(e), 1024, 6) and cloud.dtype == np.float32
            assert (
                (cloud[..., 2] > 0.744).all()
                and (cloud[..., 3:] >= 0).all()
                and (cloud[..., 3:] <= 1).all()
            )
            # the bell stands where the log says
            gap = np.linalg.norm(
                cloud[:, :, :2] - e.array("objects/bell/pose")[:, None, :2], axis=-1
            ).min(1)
            assert gap[0] < 0.03


def test_a_late_camera_shows_the_frames_before_byte_for_byte(source, tmp_path):
    out = Dataset(tmp_path / "out")
    draw(source, out, sensors={"latency": 2})
    for path, plain in zip(paths(out), paths(source), strict=True):
        with EpisodeFile(path) as e, EpisodeFile(plain) as s:
            for camera in e.cameras:
                late, now = (
                    e.array(f"observation/{camera}/rgb"),
                    s.array(f"observation/{camera}/rgb"),
                )
                assert np.array_equal(late[2:], now[:-2]) and (late[:2] == now[0]).all()
                assert np.array_equal(
                    e.array(f"observation/{camera}/pose")[2:],
                    s.array(f"observation/{camera}/pose")[:-2],
                )
            assert physics_id(e.read().spec, e.read().log) == physics_id(
                s.read().spec, s.read().log
            )
    assert failed(out) == []
    again = Dataset(tmp_path / "again")
    draw(out, again, sensors="none")
    assert files(again, "episodes/**/*.hdf5") == files(source, "episodes/**/*.hdf5")


def test_textures_and_light_of_ones_own_are_kept_with_the_dataset(source, tmp_path):
    own = tmp_path / "own"
    (own / "table").mkdir(parents=True)
    cv2.imwrite(str(own / "table" / "red.png"), np.full((8, 8, 3), (20, 20, 200), np.uint8))
    (own / "LICENSE").write_text("CC-BY-4.0\n")
    cv2.imwrite(str(own / "sky.hdr"), np.ones((16, 32, 3), np.float32))
    out, again, back = (Dataset(tmp_path / name) for name in ("out", "again", "back"))
    draw(source, out, textures=str(own), environment=str(own / "sky.hdr"))
    shutil.rmtree(own)
    read_unchanged.cache_clear()
    assert failed(out) == []
    assert json.loads(out.provenance.read_text())["licences"].items() >= {
        ("textures", "CC-BY-4.0"),
        ("environment", "CC-BY-4.0"),
    }
    for path in paths(out):
        with EpisodeFile(path) as e:
            red, _, blue = e.rgb("head_camera", 0)[20:-20].reshape(-1, 3).mean(0)
            visuals = e.meta.drawing.visuals
        assert red > 2 * blue and (visuals.table.pattern, visuals.wall.pattern, visuals.points) == (
            "image",
            "workshop",
            (),
        )
    draw(out, again)
    assert files(again) == files(out)
    draw(out, back, textures="seen", environment="none")
    assert files(back, "episodes/**/*.hdf5") == files(source, "episodes/**/*.hdf5")


def test_variants_show_the_same_physics_in_other_looks(source, tmp_path):
    out, changes = (
        Dataset(tmp_path / "out"),
        {"size": (128, 96), "cameras": ["head"], "visuals": "randomized", "visual_seed": 7},
    )
    result = draw(source, out, variants=3, **changes)
    assert (result.slots, result.drawn) == (6, 6)
    names = [p.name for p in paths(out)[:3]]
    assert names == ["episode_0000000.hdf5", "episode_0000000_v1.hdf5", "episode_0000000_v2.hdf5"]
    for number, original in enumerate(paths(source)):
        with EpisodeFile(original) as s:
            log, spec, known = s.read().log, s.spec, s.meta.physics_id
        assert known == physics_id(spec, log)
        looks, means = [], []
        for variant, path in enumerate(paths(out)[3 * number : 3 * number + 3]):
            with EpisodeFile(path) as e:
                assert (e.meta.variant, e.meta.physics_id, e.spec) == (variant, known, spec)
                np.testing.assert_array_equal(e.read().log.poses, log.poses)
                assert e.rgb("head_camera", 0).shape == (96, 128, 3)
                looks.append(e.meta.drawing.visuals)
                means.append(e.rgb("head_camera", 0)[60:].mean((0, 1)))
        assert len({repr(look) for look in looks}) == 3
        assert min(np.abs(a - b).max() for i, a in enumerate(means) for b in means[:i]) > 5
    assert failed(out) == []
    counts = status(out)
    assert (counts["wanted"], counts["accepted"], counts["attempt_success"]) == (
        6,
        6,
        status(source)["attempt_success"],
    )
    # every export says which rows must stay together
    run_export("parquet", out.root, out.exports("parquet"), paths(out))
    table = pq.read_table(out.exports("parquet") / "episodes.parquet")
    assert table.column("variant").to_pylist() == [0, 1, 2] * 2
    assert len(set(table.column("physics_id").to_pylist())) == 2
    rows = pq.read_table(
        out.exports("parquet") / "data-00000.parquet",
        columns=["physics_id", "variant", "episode_index"],
    )
    assert set(zip(*rows.to_pydict().values(), strict=True)) == {
        (row["physics_id"], row["variant"], row["episode_index"]) for row in table.to_pylist()
    }


def test_more_variants_change_none_of_those_there_are(source, tmp_path):
    out = Dataset(tmp_path / "out")
    draw(source, out, variants=2, **SMALL)
    before = files(out, "episodes/**/*.hdf5")
    assert draw(source, out, variants=3, **SMALL).drawn == 2
    after = files(out, "episodes/**/*.hdf5")
    assert len(after) == 6 and before.items() <= after.items()
    other = Dataset(tmp_path / "other")
    draw(source, other, variants=1, visual_seed=1, **SMALL)
    assert not set(files(other, "episodes/**/*.hdf5").values()) & set(after.values())
    # looks that are stored are kept, whatever they were drawn from
    copy = Dataset(tmp_path / "copy")
    draw(out, copy)
    assert files(copy, "episodes/**/*.hdf5") == after
    clean = Dataset(tmp_path / "clean")
    assert draw(out, clean, visuals="clean", variants=1).slots == 2
    for path in paths(clean):
        with EpisodeFile(path) as e:
            assert e.meta.drawing.visuals.table.pattern == "staves"


def test_a_build_of_several_variants_has_those_of_a_rendering(source, tmp_path):
    out, built = Dataset(tmp_path / "out"), Dataset(tmp_path / "built")
    draw(source, out, variants=2, **SMALL)
    result = build(built.root, recipe_from(RECIPE | SMALL | {"variants": 2}), Crew(), shown="none")
    assert (result.slots, result.accepted, result.made) == (4, 4, 2)
    assert files(built) == files(out)
    assert failed(built) == []
    assert build(built.root, built.recipe(), Crew(), shown="none").made == 0
    assert files(built) == files(out)


# --- old and damaged sources
# ------------------------------------------------------------------------------------------


def rename(dataset, task):
    """The dataset as if it had been made of a task that this version does not have."""
    records = [record for _, record in dataset.records(dataset.recipe())]
    (dataset.episodes / "click_bell").rename(dataset.episodes / task)
    dataset.index.unlink()
    lines = dataset.manifest.read_text().replace("click_bell", task).splitlines(keepends=True)
    dataset.manifest.write_bytes(
        seal_yaml("".join(line for line in lines if not line.startswith(SEAL)))
    )
    for slot, record in zip(dataset.recipe().slots(), records, strict=True):
        with h5py.File(dataset.episode(slot), "r+") as f:
            f.attrs["spec"] = f.attrs["spec"].replace("click_bell", task)
        reseal(dataset, slot, record)


def reseal(dataset, slot, record):
    path = dataset.episode(slot)
    file = replace(
        record.file, size=path.stat().st_size, changed=path.stat().st_mtime_ns, physics_id=""
    )
    record_all(dataset, [(slot, replace(record, sha256=file_hash(path), file=file))])


def test_a_task_and_a_robot_that_are_gone_can_still_be_drawn(mine, source, tmp_path):
    rename(mine, "click_gong")
    out = Dataset(tmp_path / "out")
    assert draw(mine, out).drawn == 2
    for path, original in zip(paths(out), paths(source), strict=True):
        with EpisodeFile(path) as e, EpisodeFile(original) as s:
            assert e.spec.task == "click_gong"
            for camera in s.cameras:
                assert np.array_equal(
                    e.array(f"observation/{camera}/rgb"), s.array(f"observation/{camera}/rgb")
                )
    assert draw(mine, out).drawn == 0
    assert verify(out)["ok"]


def test_one_damaged_episode_keeps_no_other_from_being_drawn(mine, tmp_path):
    first, second = mine.recipe().slots()
    path, out = mine.episode(first), tmp_path / "out"
    path.write_bytes(path.read_bytes()[:-100])
    arguments = (
        "render",
        mine.root,
        "--out",
        out,
        "--size",
        "64x48",
        "--cameras",
        "head",
        "--executor",
        "inline",
        "--json",
    )
    code, said, err = inside(*arguments)
    values = json.loads(said)
    assert (code, values["drawn"], values["accepted"]) == (1, 1, 1)
    assert len(values["problems"]) == 1 and str(path) in values["problems"][0]
    assert "Traceback" not in err
    assert (
        Dataset(out).episode(second).exists()
        and first not in Dataset(out).rows(Dataset(out).recipe()).slots
    )
    # an asset that is missing is the problem of those episodes that show it
    with EpisodeFile(mine.episode(second)) as e:
        lost = Dataset(mine.root).bodies / e.meta.drawing.assets["bell"][:2]
    shutil.rmtree(lost)
    shutil.rmtree(out)
    from pipeline.run.slot import redraw

    redraw._load_parts.cache_clear()
    code, said, _ = inside(*arguments)
    problems = json.loads(said)["problems"]
    assert code == 1 and any("is missing" in p for p in problems)


# --- who draws
# ------------------------------------------------------------------------------------------


OPTIONS = (
    "--size",
    "64x48",
    "--cameras",
    "head",
    "--sensors",
    SENSORS,
    "--visuals",
    "randomized",
    "--quiet",
)


@pytest.mark.slow
@pytest.mark.parametrize("crew", [Crew(), Crew("ray", 2)], ids=["inline", "ray"])
def test_a_killed_rendering_goes_on_to_the_same_bytes(source, tmp_path, crew):
    whole, out, variants = Dataset(tmp_path / "whole"), Dataset(tmp_path / "out"), 3
    draw(source, whole, variants=variants, **SMALL)
    process = start(
        "render",
        source.root,
        "--out",
        out.root,
        *OPTIONS,
        "--variants",
        variants,
        "--executor",
        "inline",
    )
    wait_for_a_slot(out.root, process)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == -signal.SIGKILL
    done = len(slots(out.root))
    assert 0 < done < 2 * variants
    rest = render(source, out, SMALL | {"variants": variants}, crew, quiet=True)
    assert rest.drawn == 2 * variants - done
    assert files(out) == files(whole)
    assert not list(out.root.rglob(".*.tmp"))


def test_an_episode_that_was_drawn_and_not_recorded_is_not_drawn_again(
    source, tmp_path, monkeypatch
):
    out, written = Dataset(tmp_path / "out"), []

    def stopped_at_the_second(job):
        drawn = redraw.draw_slot(job)
        written.append(job.slot)
        if len(written) == 2:
            raise KeyboardInterrupt
        return drawn

    monkeypatch.setattr(drawing, "draw_slot", stopped_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        draw(source, out, **SMALL)
    assert out.rows(out.recipe()).slots == written[:1] and out.episode(written[1]).exists()
    assert draw(source, out, **SMALL).drawn == 0
    assert out.rows(out.recipe()).slots == written
    whole = Dataset(tmp_path / "whole")
    draw(source, whole, **SMALL)
    assert files(out) == files(whole)
    assert not list(out.root.rglob(".*.tmp"))


# --- bad input
# ------------------------------------------------------------------------------------------

TOP = (
    '{"name": "%s", "link": %s, "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48,'
    ' "fovy": 40}'
)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--cameras", "hed"), "hed"),
        (("--cameras", "head,head"), "twice"),
        (("--cameras", ""), "cameras"),
        (("--cameras", '{"name": "x"'), "JSON"),
        (("--cameras", '{"name": "x"}'), "width"),
        (("--cameras", TOP % ("../up", "null")), "../up"),
        (("--cameras", TOP % ("top", '"left_tail"')), "left_tail"),
        (("--size", "640"), "--size"),
        (("--size", "640x-1"), "--size"),
        (("--size", "8x8"), "size"),
        (("--sensors", "fog=1"), "fog"),
        (("--textures", "nowhere"), "no directory of textures"),
        (("--environment", "nowhere.hdr"), "cannot be read"),
        (("--sensors", "noise"), "noise=2"),
        (("--sensors", "motion_blur=80"), "66.7 ms"),
        (("--render", "lovely"), "lovely"),
        (("--pointcloud", "--cameras", "left"), "head"),
        (("--visuals", "dirty"), "dirty"),
        (("--variants", "3"), "--visuals randomized"),
        (("--visuals", "randomized", "--variants", "0"), "variants"),
        (("--visuals", "randomized", "--visual-seed", "-1"), "--visual-seed"),
        (("--executor", "mars"), "--executor"),
        (("--workers", "0"), "--workers"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(source, tmp_path, arguments, said):
    code, out, err = inside("render", source.root, "--out", tmp_path / "out", *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and err.startswith("domino-data: ")
    assert said in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["missing", "foreign", "empty", "itself"])
def test_what_cannot_be_drawn_from_is_one_line(source, tmp_path, place):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "thesis.txt").write_text("precious")
    Dataset(tmp_path / "empty").create(recipe_from(RECIPE))
    given = source.root if place == "itself" else tmp_path / place
    out = source.root if place == "itself" else tmp_path / "out"
    before = files(source)
    code, _, err = inside("render", given, "--out", out)
    assert code == 2 and err.count("\n") == 1
    assert given.name in err
    assert files(source) == before and not (tmp_path / "out").exists()


def test_an_out_that_holds_something_else_is_left_alone(source, tmp_path):
    out = Dataset(tmp_path / "out")
    draw(source, out, variants=2, **SMALL)
    before = files(out)
    for arguments in (OPTIONS[:-1], (*OPTIONS[:-1], "--variants", "2", "--visual-seed", "3"), ()):
        code, _, err = inside("render", source.root, "--out", out.root, *arguments)
        assert code == 2 and "another recipe" in err
    assert files(out) == before
