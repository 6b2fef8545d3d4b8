"""Bundles of results: honest ones are accepted, forged ones are found."""

import gzip
import hashlib
import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.evaluate.bundle import (
    ACTIONS,
    BUNDLE,
    BundleError,
    actions_file,
    hash_rows,
    pack,
    read_bundle,
    unpack,
)
from pipeline.evaluate.scenes.manifests import inline
from pipeline.run.check_result import check_result

WORDS = ("--tasks", "click_bell", "--levels", "1", "--embodiment", "aloha", "--episodes", "2")


HERE = ("--executor", "inline", "--quiet")


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """A bundle of two policies on two scenes, one of which waits for its answers."""
    out = tmp_path_factory.mktemp("bundle") / "out"
    for policy, clock in (("static", "sim"), ("chaser", "latency:100")):
        said = CliRunner().invoke(
            app,
            ["evaluate", "--policy", policy, *WORDS, "--clock", clock, "--out", str(out), *HERE],
        )
        assert said.exit_code == 0, said.output
    return out


@pytest.fixture
def bundle(honest, tmp_path):
    return shutil.copytree(honest, tmp_path / "out")


def rows_of(out):
    return [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]


def write_rows(out, rows):
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    (out / "episodes.jsonl").write_text(text)


def forge_hashes(out, rows):
    """Write rows with the hash in bundle.json that fits them: a forger who knows the format."""
    write_rows(out, rows)
    entries = json.loads((out / BUNDLE).read_text())
    for entry, result in zip(entries, read_bundle(out), strict=True):
        entry["rows"] = hash_rows(row for row in rows if result.owns(json.loads(row["key"])))
    (out / BUNDLE).write_text(json.dumps(entries))


def test_an_honest_bundle_holds_in_every_number(honest):
    checked = check_result(honest, inline, again=4)
    assert (checked.episodes, checked.again, checked.exact) == (4, 4, True)
    assert checked.faults == []
    kinds = {row["clock"]: row["success"] for row in rows_of(honest)}
    assert set(kinds) == {"sim", "latency:100"}


def test_evaluations_of_one_policy_may_share_a_directory(bundle):
    words = ["evaluate", "--policy", "static", *WORDS, "--out", str(bundle), *HERE]
    for more in (["--levels", "0", "--episodes", "1"], ["--levels", "0,1", "--episodes", "2"]):
        assert CliRunner().invoke(app, [*words, *more]).exit_code == 0
    checked = check_result(bundle, inline)
    assert (checked.episodes, checked.faults) == (6, [])


def edited(out):
    rows = rows_of(out)
    rows[0]["success"] = not rows[0]["success"]
    write_rows(out, rows)


def edited_with_hash(out):
    rows = rows_of(out)
    rows[0]["success"] = not rows[0]["success"]
    forge_hashes(out, rows)


def better_score(out):
    rows = rows_of(out)
    rows[1]["route_completion"] = 99.0
    forge_hashes(out, rows)


def dropped(out):
    forge_hashes(out, rows_of(out)[1:])


def another_clock(out):
    text = (out / "episodes.jsonl").read_text().replace("latency:100", "sim")
    rows = [json.loads(line) for line in text.splitlines()]
    for row in rows:
        old = actions_file(out, row["key"].replace('"sim"', '"latency:100"'))
        if row["policy"] == "chaser":
            old.rename(actions_file(out, row["key"]))
    bundle = (out / BUNDLE).read_text().replace("latency:100", "sim")
    (out / BUNDLE).write_text(bundle)
    forge_hashes(out, rows)


def fewer_scenes(out):
    """The last scene and its rows are left out, everywhere but in the number of episodes."""
    manifest = next((out / "manifests").rglob("*.json"))
    values = json.loads(manifest.read_text())
    seed = values["cases"].pop()["spec"]["seed"]
    values["tried"] -= 1
    values["sha256"] = hashlib.sha256(
        json.dumps(values["cases"], sort_keys=True).encode()
    ).hexdigest()
    manifest.write_text(json.dumps(values))
    forge_hashes(out, [row for row in rows_of(out) if row["seed"] != seed])


def exchanged_actions(out):
    first, second = (actions_file(out, row["key"]) for row in rows_of(out)[:2])
    first.write_bytes(second.read_bytes())


def actions_of_another(out):
    """An episode has actions that were not carried out, with all hashes."""
    rows = rows_of(out)
    one, other = rows[:2]
    commands = unpack(actions_file(out, other["key"]).read_bytes())
    commands[:, 1] += 0.3
    data = pack(commands)
    actions_file(out, one["key"]).write_bytes(data)
    one["actions"] = hashlib.sha256(data).hexdigest()
    forge_hashes(out, rows)


@pytest.mark.parametrize(
    ("forge", "again"),
    [
        (edited, 0),
        (edited_with_hash, 4),
        (better_score, 4),
        (dropped, 0),
        (another_clock, 0),
        (fewer_scenes, 0),
        (exchanged_actions, 0),
        (actions_of_another, 4),
    ],
)
def test_a_forgery_is_found(bundle, forge, again):
    forge(bundle)
    assert check_result(bundle, inline, again).faults


def test_the_command_names_the_fault_and_ends_with_1(bundle):
    edited_with_hash(bundle)
    row = rows_of(bundle)[0]
    words = ["check-result", str(bundle), "--again", "4", "--executor", "inline"]
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 1
    assert f"seed {row['seed']}: success is {row['success']}" in said.output


def test_files_of_strangers_are_refused_in_one_line(bundle):
    empty = bundle / ACTIONS
    with pytest.raises(BundleError):
        check_result(empty, inline)
    (bundle / BUNDLE).write_text('[{"code": 1}]')
    with pytest.raises(BundleError):
        check_result(bundle, inline)


def test_commands_are_read_within_bounds(bundle):
    path = next((bundle / ACTIONS).iterdir())
    path.write_bytes(gzip.compress(bytes(1 << 27)))
    rows = rows_of(bundle)
    for row in rows:
        row["actions"] = hashlib.sha256(path.read_bytes()).hexdigest()
    forge_hashes(bundle, rows)
    faults = check_result(bundle, inline).faults
    assert any("more than" in fault for fault in faults)
    with pytest.raises(ValueError, match="holds no commands"):
        unpack(pack(np.zeros(3)))


def commanding(change):
    """A forgery of all commands, with the hashes that fit."""

    def forge(out):
        rows = rows_of(out)
        for row in rows:
            path = actions_file(out, row["key"])
            data = pack(change(unpack(path.read_bytes())))
            path.write_bytes(data)
            row["actions"] = hashlib.sha256(data).hexdigest()
        forge_hashes(out, rows)

    return forge


@pytest.mark.parametrize(
    "change", [lambda c: c * np.nan, lambda c: c + np.inf, lambda c: c[:, :4], lambda c: c[:, :0]]
)
def test_commands_that_no_robot_takes_are_faults(bundle, change):
    commanding(change)(bundle)
    assert len(check_result(bundle, inline, again=1).faults) >= 1


def test_a_cell_named_like_a_path_is_refused(bundle):
    text = (bundle / BUNDLE).read_text().replace('"click_bell"', '"../../click_bell"')
    (bundle / BUNDLE).write_text(text)
    with pytest.raises(BundleError, match="is no name"):
        check_result(bundle, inline)


@pytest.mark.parametrize(("part", "value"), [(5, 5), (3, "5"), (3, "[1]")])
def test_a_key_of_another_kind_is_a_fault(bundle, part, value):
    rows = rows_of(bundle)
    key = json.loads(rows[0]["key"])
    key[part] = value
    rows[0]["key"] = json.dumps(key)
    write_rows(bundle, rows)
    assert check_result(bundle, inline).faults
