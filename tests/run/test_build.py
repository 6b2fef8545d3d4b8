"""The whole way through the real command: build, stop, go on, verify, export; the same bytes
whoever does the work."""

import json
import os
import shutil
import signal
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import h5py
import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key
from pipeline.data.slots.reread import IndexWriter
from pipeline.run.names import recipe_from
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from tests.full_disk import longest_file
from tests.recording import record_all
from tests.run.command import WANTED, contents, inside, slots, temporaries

pytestmark = pytest.mark.usefixtures("without_report")


@pytest.fixture
def mine(built, tmp_path):
    """A copy to write to."""
    return Path(shutil.copytree(built, tmp_path / "mine"))


# --- one dataset
# ------------------------------------------------------------------------------------------


def test_a_built_dataset_keeps_its_promises(built):
    found = json.loads(inside("verify", built, "--json")[1])
    assert (found["ok"], found["problems"], found["episodes"]) == (True, [], 3)
    _, out, _ = inside("status", built, "--json")
    status = json.loads(out)
    assert (status["wanted"], status["accepted"], status["given_up"], status["open"]) == (
        3,
        3,
        0,
        0,
    )
    rows = pq.read_table(built / "attempts.parquet").to_pylist()
    assert status["attempts"] == len(rows)
    assert [r["level"] for r in rows if r["outcome"] == "accepted"] == [1, 2, 3]
    assert all(r["reason"] for r in rows if r["outcome"] != "accepted")
    assert "click bell" in (built / "report" / "index.html").read_text()
    assert not temporaries(built)


def test_a_finished_dataset_is_left_as_it_is(mine):
    before = {p: p.stat().st_mtime_ns for p in mine.glob("episodes/**/*.hdf5")}
    code, out, _ = inside("build", *WANTED, "--out", mine, "--quiet", "--json")
    assert code == 0
    assert (json.loads(out)["made"], json.loads(out)["accepted"]) == (0, 3)
    code, _, err = inside("build", *WANTED, "--out", mine, "--quiet", "--seed", "5")
    assert code == 2
    assert "another recipe" in err
    assert {p: p.stat().st_mtime_ns for p in mine.glob("episodes/**/*.hdf5")} == before


def test_a_dataset_grows_and_keeps_what_it_holds(mine):
    before = {p: p.read_bytes() for p in mine.glob("episodes/**/*.hdf5")}
    larger = (
        *WANTED,
        "--levels",
        "0,1,2,3",
        "--out",
        mine,
        "--quiet",
        "--json",
        "--executor",
        "inline",
    )
    code, out, err = inside("build", *larger)
    assert (code, err) == (0, "")
    assert (json.loads(out)["made"], json.loads(out)["accepted"]) == (1, 4)
    assert {p: p.read_bytes() for p in before} == before
    code, out, err = inside("build", *WANTED, "--out", mine, "--quiet")
    assert (code, out) == (2, "")
    assert "levels 0" in err and err.count("\n") == 1


def test_episodes_of_another_version_are_exported_and_annotated(mine):
    dataset = Dataset(mine)
    for slot, record in dataset.records(dataset.recipe()):
        physics = Key(record.keys.physics.parts | {"core": "0" * 32})
        record_all(dataset, [(slot, replace(record, keys=replace(record.keys, physics=physics)))])
    for words in (
        ("export", mine, "--format", "parquet", "--where", "level=1"),
        ("annotate", mine, "--stages", "flow", "--flow-stride", "2", "--where", "level=1"),
    ):
        code, out, _ = inside(*words, "--json")
        assert (code, json.loads(out)["episodes"]) == (0, 1)


def test_exports_take_the_episodes_asked_for_and_are_checked_with_the_dataset(mine):
    for name, some, count in (
        ("aloha", ("--embodiment", "aloha", "--where", "level>2"), 1),
        ("parquet", (), 3),
    ):
        code, out, err = inside("export", mine, "--format", name, *some, "--json")
        assert code == 0, err
        assert json.loads(out)["episodes"] == count
    code, _, err = inside("export", mine, "--format", "aloha", "--embodiment", "piper")
    assert code == 2 and "--embodiment piper: the dataset has only aloha-agilex" in err
    next((mine / "exports" / "parquet").glob("data-*.parquet")).write_bytes(b"")
    code, out, _ = inside("verify", mine, "--json")
    problems = json.loads(out)["problems"]
    assert code == 1 and {problem.partition(":")[0] for problem in problems} == {"exports/parquet"}


def test_a_damaged_episode_is_found_and_made_again(mine, built):
    path = next(mine.glob("episodes/**/L2/**/*.hdf5"))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    code, out, err = inside("verify", mine, "--json")
    assert (code, err) == (1, "")
    problems = json.loads(out)["problems"]
    assert {problem.partition(":")[0] for problem in problems} == {
        path.relative_to(mine).as_posix()
    }
    path.unlink()
    code, out, err = inside(
        "build", *WANTED, "--out", mine, "--quiet", "--json", "--executor", "inline"
    )
    assert (code, err, json.loads(out)["made"]) == (0, "", 1)
    assert contents(mine) == contents(built)


def test_a_damaged_and_a_missing_episode_and_missing_assets_are_made_again(mine, built):
    first, second = sorted(mine.glob("episodes/**/*.hdf5"))[:2]
    gone, damaged, *others = sorted(mine.glob("assets/bodies/*/*.npz"))
    gone.unlink()
    damaged.unlink()
    first.write_bytes(first.read_bytes()[:5000])
    second.unlink()
    code, out, err = inside(
        "build", *WANTED, "--out", mine, "--quiet", "--json", "--executor", "inline"
    )
    assert (code, err) == (0, "")
    assert json.loads(out)["made"] == 3
    assert contents(mine) == contents(built)
    assert {p.name: p.read_bytes() for p in (gone, damaged)} == {
        p.name: (built / p.relative_to(mine)).read_bytes() for p in (gone, damaged)
    }
    assert others


@pytest.mark.parametrize(
    "verb", [("export", "--format", "parquet"), ("annotate", "--stages", "flow")]
)
def test_episodes_with_other_bytes_are_neither_exported_nor_annotated(mine, verb):
    path = next(mine.glob("episodes/**/L2/**/*.hdf5"))
    with h5py.File(path, "r+") as file:
        file["joint_action/vector"][0, 0] += 1e-3
    code, out, err = inside(verb[0], mine, *verb[1:], "--json")
    assert code == (2 if verb[0] == "export" else 1)
    said = err if verb[0] == "export" else json.loads(out)["stages"][0]["problems"][0]
    assert str(path) in said
    assert "bytes differ from the index's sha256" in said
    assert not list(mine.glob("exports/*")) and len(list(mine.glob("annotations/*/**/*.h5"))) == (
        0 if verb[0] == "export" else 2
    )


# --- who does the work
# ------------------------------------------------------------------------------------------


def test_an_interrupted_build_goes_on_to_the_same_bytes(built, tmp_path, monkeypatch):
    """A killed one: test_chaos.py, test_on_a_store.py."""
    out = tmp_path / "out"
    wanted = ("build", *WANTED, "--out", out, "--quiet", "--executor", "inline")

    def interrupted(*arguments):
        if len(slots(out)) == 1:
            signal.raise_signal(signal.SIGINT)
        return attempt(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr("pipeline.run.slot.fill.attempt", interrupted)
        code, _, err = inside(*wanted)
    assert code == 130
    assert err.count("\n") == 1 and "rerun the same command to resume" in err
    assert len(slots(out)) == 1
    code, told, err = inside(*wanted, "--json")
    assert (code, err, json.loads(told)["made"]) == (0, "", 2)
    assert contents(out) == contents(built)
    assert not temporaries(out)


def test_a_full_disk_is_one_line_and_leaves_no_half_episode(tmp_path, monkeypatch):
    opened, out = h5py.File.__init__, tmp_path / "out"
    with ExitStack() as full:

        def cramped(self, *arguments, **options):
            full.enter_context(longest_file(40_000))
            opened(self, *arguments, **options)

        monkeypatch.setattr(h5py.File, "__init__", cramped)
        code, _, err = inside(
            "build", *WANTED, "--levels", "1", "--out", out, "--quiet", "--executor", "inline"
        )
    assert (code, err.count("\n")) == (2, 1)
    assert "too large" in err
    assert [p.name for p in out.rglob("*") if p.suffix in (".hdf5", ".tmp", ".json")] == [
        "provenance.json"
    ]


def test_a_build_that_gives_slots_up_says_so_with_a_code_of_its_own(tmp_path, monkeypatch):
    def failing(*_):
        raise Failure("back_calculate", "no_motion", "workspace 828, visibility 1, blocked 171")

    monkeypatch.setattr("pipeline.run.slot.fill.attempt", failing)
    arguments = (
        *WANTED,
        "--attempts",
        "2",
        "--out",
        tmp_path / "out",
        "--quiet",
        "--executor",
        "inline",
    )
    code, out, err = inside("build", *arguments)
    assert code == 3
    assert "0 of 3 episodes" in out
    assert (
        err.count("\n") == 1
        and "slots given up after 2 attempts each: 3;" in err
        and "domino-data status" in err
    )
    assert inside("build", *arguments)[0] == 3
    code, out, _ = inside("status", tmp_path / "out")
    assert code == 0
    assert (
        "6 x back_calculate: no_motion (motions refused: workspace 4968, blocked 1026,"
        " visibility 6)" in out
    )
    rows = pq.read_table(tmp_path / "out" / "attempts.parquet").to_pylist()
    assert {row["detail"] for row in rows} == {"workspace 828, visibility 1, blocked 171"}


def test_a_policy_that_cannot_be_made_leaves_no_dataset(tmp_path):
    (tmp_path / "policy.py").write_text("x = 1\n")
    wanted = (
        "build",
        *WANTED,
        "--corrections",
        tmp_path / "policy.py",
        "--out",
        tmp_path / "out",
        "--executor",
        "inline",
    )
    code, _, err = inside(*wanted)
    assert code == 2 and "make_policy()" in err and err.count("\n") == 1
    contract = (
        "from pipeline.evaluate.policies.contract import Contract\nfrom"
        " pipeline.evaluate.policies.reference import Random\n"
    )
    (tmp_path / "policy.py").write_text("import os\nos._exit(0)\n")
    code, _, err = inside(*wanted)
    assert code == 2 and "policy.py" in err and err.count("\n") == 1
    (tmp_path / "policy.py").write_text(
        contract + "class Fast(Random):\n    contract = Contract(rate=30)\nmake_policy = Fast\n"
    )
    code, _, err = inside(*wanted)
    assert code == 2 and "30" in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


# --- planning and bad input
# ------------------------------------------------------------------------------------------


def test_a_plan_writes_nothing(monkeypatch, tmp_path, built):
    monkeypatch.chdir(tmp_path)
    arguments = (
        "--tasks",
        "click_bell,grab_roller",
        "--levels",
        "0,2",
        "--alpha",
        "0.1,0.2",
        "--episodes",
        "7",
        "--json",
    )
    code, out, _ = inside("plan", *arguments, "--workers", "2", "--out", tmp_path / "none")
    values = json.loads(out)
    assert code == 0
    # level 0 once, level 2 at two speeds
    assert len(values["cells"]) == 2 * 3
    assert values["slots"] == 2 * 3 * 7
    assert values["finished"] == 0
    assert values["estimated_hours"] > 0
    assert values["estimated_bytes"] > 42e5
    assert list(tmp_path.iterdir()) == []
    _, out, _ = inside("plan", *WANTED, "--out", built, "--json")
    values = json.loads(out)
    assert (values["finished"], values["estimated_bytes"], values["estimate_from"]) == (
        3,
        0,
        "this dataset",
    )


def test_lists_are_for_programs_to_read():
    _, out, _ = inside("tasks", "--json")
    bell = next(t for t in json.loads(out) if t["name"] == "click_bell")
    assert bell["category"] == "tracking"
    assert bell["objects"] == ["bell"]
    assert bell["step_limit"] > 0
    _, out, _ = inside("embodiments", "--json")
    assert {"aloha-agilex", "arx-x5", "franka-panda", "piper", "ur5-wsg"} <= {
        e["name"] for e in json.loads(out)
    }


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--tasks", "clik_bell"), "clik_bell"),
        (("--levels", "4"), "levels"),
        (("--levels", "fast"), "--levels"),
        (("--levels", ""), "levels"),
        (("--alpha", "-1"), "alpha"),
        (("--alpha", "nan"), "alpha"),
        (("--embodiment", "r2d2"), "r2d2"),
        (("--domains", "dirty"), "domains"),
        (("--episodes", "0"), "episodes"),
        (("--attempts", "0"), "attempts"),
        (("--seed", "-3"), "seed"),
        (("--render", "lovely"), "render"),
        (("--executor", "mars"), "--executor"),
        (("--workers", "0"), "--workers"),
        (("--manifest", "missing.yaml"), "missing.yaml"),
        (("--manifest", "unknown.yaml"), "episdoes"),
        (("--manifest", "broken.yaml"), "broken.yaml"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(monkeypatch, tmp_path, arguments, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "unknown.yaml").write_text("tasks: click_bell\nepisdoes: 3\n")
    (tmp_path / "broken.yaml").write_text("a: [1\nb: {")
    for verb in ("build", "plan"):
        if verb == "plan" and arguments[0] == "--executor":
            continue
        code, out, err = inside(verb, *arguments, "--out", "OUT")
        assert (code, out) == (2, "")
        assert err.count("\n") == 1
        assert err.startswith("domino-data: ")
        assert said in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["broken.yaml", "unknown.yaml"]


def test_a_cluster_that_cannot_be_joined_leaves_no_dataset(tmp_path):
    # which would refuse another recipe
    code, out, err = inside(
        "build", "--tasks", "click_bell", "--address", "127.0.0.1:1", "--out", str(tmp_path / "set")
    )
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "no Ray cluster at 127.0.0.1:1" in err and "another --address" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("verb", [("status",), ("verify",), ("export", "--format", "parquet")])
@pytest.mark.parametrize("place", ["missing", "foreign", "file", "damaged"])
def test_a_place_that_is_no_dataset_is_one_line(tmp_path, verb, place):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "thesis.txt").write_text("precious")
    (tmp_path / "file").write_text("x")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "manifest.yaml").write_text("levels: [9]\n")
    code, _, err = inside(*verb, tmp_path / place)
    assert code == 2
    assert err.count("\n") == 1
    assert place in err


@pytest.mark.parametrize("place", ["foreign", "file"])
def test_a_build_leaves_other_peoples_files_alone(tmp_path, place):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "thesis.txt").write_text("precious")
    (tmp_path / "file").write_text("x")
    code, _, err = inside(
        "build", *WANTED, "--executor", "inline", "--quiet", "--out", tmp_path / place
    )
    assert code == 2
    assert err.count("\n") == 1
    assert [p.name for p in (tmp_path / "foreign").iterdir()] == ["thesis.txt"]
    assert (tmp_path / "file").read_text() == "x"


def test_exports_of_nothing_and_of_an_unknown_kind_are_refused(tmp_path):
    recipe = recipe_from({"tasks": "click_bell", "levels": 1, "episodes": 1})
    (tmp_path / "manifest.yaml").write_text(recipe.to_yaml())
    for name, said in (("parquet", "no finished episodes"), ("gif", "gif")):
        code, _, err = inside("export", tmp_path, "--format", name)
        assert code == 2
        assert said in err
        assert err.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["index.sqlite", "manifest.yaml"]


def test_the_index_may_go_at_any_time(built, tmp_path, monkeypatch):
    """Removed or cut while a build runs: the build ends with what one that was left alone has, and
    nothing is made twice."""
    out, damage, attempts = (
        tmp_path / "out",
        [Path.unlink, lambda path: os.truncate(path, 5000)],
        [],
    )

    def disturbed(*arguments):
        attempts.append(arguments[0])
        if slots(out) and damage:
            damage.pop()(out / "index.sqlite")
        return attempt(*arguments)

    monkeypatch.setattr("pipeline.run.slot.fill.attempt", disturbed)
    code, said, err = inside(
        "build", *WANTED, "--out", out, "--quiet", "--json", "--executor", "inline"
    )
    assert (code, err, json.loads(said)["made"], damage) == (0, "", 3, [])
    assert len({spec.seed for spec in attempts}) == len(attempts) == json.loads(said)["attempts"]
    files, records, rows = contents(built)
    found = contents(out, timed=False)
    assert found[0] == files and found[2] == rows and {*found[1]} == {*records}


def test_an_episode_without_a_row_is_read_by_the_next_build(mine, built):
    dataset = Dataset(mine)
    with IndexWriter(dataset, dataset.recipe()) as writer, writer.index._file as file:
        file.execute("DELETE FROM slot WHERE id = 2")
    code, out, _ = inside(
        "build", *WANTED, "--out", mine, "--quiet", "--json", "--executor", "inline"
    )
    assert (code, json.loads(out)["made"]) == (0, 0)
    assert contents(mine, timed=False)[0] == contents(built)[0]
