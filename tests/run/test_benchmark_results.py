"""Results on a benchmark: equal bytes again and on two workers, and other scenes are found."""

import json
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.evaluate.bundle import ACTIONS, BUNDLE
from pipeline.evaluate.evaluate import evaluate
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.benchmark import read_benchmark
from pipeline.evaluate.scenes.case import BLIND, BenchmarkError
from pipeline.evaluate.scenes.manifests import inline
from pipeline.evaluate.scoring.compare import CompareError, read_arms
from pipeline.run.check_result import check_result
from pipeline.run.evaluation import evaluation_of
from tests.run.command import inside

HERE = ("--executor", "inline", "--quiet")
CELLS = ("--tasks", "click_bell", "--levels", "0,1", "--embodiment", "aloha")


def command(*words):
    code, said, error = inside(*words)
    assert code == 0, error
    return said


def refused(*words):
    code, _, error = inside(*words)
    assert (code, error.count("\n")) == (2, 1), error
    return error


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("benchmark") / "bells.jsonl.xz"
    made = command(
        "freeze", *CELLS, "--scenes", 2, "--part", "all=click_bell", "--out", path, *HERE
    )
    assert "4 scenes" in made
    return path


def test_freeze_takes_no_events_and_replaces_no_other_benchmark(file, tmp_path):
    before, words = file.read_bytes(), ("freeze", *CELLS, "--out", file, *HERE)
    assert "remove the file" in refused(*words, "--scenes", 1)
    assert "remove the file" in refused(*words, "--scenes", 2)  # without its part
    assert file.read_bytes() == before
    command(*words, "--scenes", 2, "--part", "all=click_bell")
    assert file.read_bytes() == before
    assert "--events" in refused(*words, "--events", "nudge")
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("tasks: click_bell\nevents: [nudge]\n")
    assert "events" in refused("freeze", "--manifest", recipe, "--out", tmp_path / "x.jsonl.xz")


def test_a_check_says_that_nothing_was_carried_out(honest, file):
    words = "check-result", honest, "--benchmark", file, "--executor", "inline"
    assert "none carried out again" in command(*words)
    assert "1 carried out again, compared: every number" in command(*words, "--again", 1)


def run(out, file, policy="static", **more):
    """Two scenes of a benchmark, one at a level."""
    frozen = read_benchmark(str(file))
    recipe = Recipe(tasks=("click_bell",), levels=(0, 1))
    name = PolicyName(policy, policy, process="evaluator")
    evaluation = evaluation_of(recipe, BLIND, name, episodes=1, benchmark=frozen)
    cells = tuple(frozen.choose(recipe, []))
    evaluate(replace(evaluation, cells=cells), out, more.get("runner", inline))
    return out


@pytest.fixture(scope="module")
def honest(file, tmp_path_factory):
    return run(tmp_path_factory.mktemp("honest") / "out", file)


@pytest.fixture
def bundle(honest, tmp_path):
    return shutil.copytree(honest, tmp_path / "out")


def contents(out):
    """All that an evaluation wrote, in whatever order, without wall times."""
    rows = map(json.loads, (out / "episodes.jsonl").read_text().splitlines())
    actions = {path.name: path.read_bytes() for path in (out / ACTIONS).iterdir()}
    by_key = {row["key"]: {**row, "seconds_spent": None} for row in rows}
    return by_key, actions, (out / BUNDLE).read_bytes()


def on_two_workers(work, jobs):
    """Every other job in this process, the rest in a new one, which are the first to end."""
    jobs = list(jobs)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield from zip(jobs[1::2], pool.map(work, jobs[1::2]), strict=True)
    yield from ((job, work(job)) for job in jobs[::2])


def test_again_and_on_two_workers_gives_equal_bytes(honest, file, tmp_path):
    assert contents(run(tmp_path / "two", file, runner=on_two_workers)) == contents(honest)


def test_the_command_takes_a_part_and_states_it(file, tmp_path):
    out = tmp_path / "out"
    words = ("evaluate", "--policy", "still", "--benchmark", f"{file}:all", "--levels", 0, *HERE)
    said = json.loads(command(*words, "--scenes", 1, "--out", out, "--json"))
    sha256 = read_benchmark(str(file)).sha256
    stated = {"name": "bells", "sha256": sha256, "part": "all", "scenes": 1, "of": 4}
    assert said["benchmark"] == stated
    assert json.loads((out / BUNDLE).read_text())[0]["benchmark"] == stated
    assert sha256[:12] in (out / "index.html").read_text()
    assert not (out / "manifests").exists()
    for more, why in (
        (("--seed", 1), "has its own"),
        (("--scenes", 9, "--policy", "missing.py"), "has 2 scenes"),
        (("--fps", 30), "has fps 15"),
        (("--levels", 3), "no scene"),
        (("--tasks", "shake_bottle"), "shake_bottle is not in part all of bells: click_bell"),
    ):
        assert why in refused(*words, "--out", tmp_path / "no", *more)
    assert not (tmp_path / "no").exists()


def test_an_honest_bundle_holds_with_its_file_alone(honest, file):
    frozen = read_benchmark(str(file))
    checked = check_result(honest, inline, again=2, benchmark=frozen)
    assert (checked.episodes, checked.again, checked.faults) == (2, 2, [])
    with pytest.raises(BenchmarkError, match="--benchmark"):
        check_result(honest, inline)
    with pytest.raises(BenchmarkError, match="which is not"):
        check_result(honest, inline, benchmark=replace(frozen, sha256="0" * 64))


def another_hash(text, label):
    return text.replace(label, f"{label[:-1]}x")


def without(text, label):
    return text.replace(f',"benchmark":"{label}"', "").replace(f',\\"benchmark {label}\\"', "")


@pytest.mark.parametrize("forge", [another_hash, without])
def test_rows_of_another_benchmark_are_found(bundle, file, forge):
    frozen, path = read_benchmark(str(file)), bundle / "episodes.jsonl"
    assert forge(path.read_text(), frozen.label) != path.read_text()
    path.write_text(forge(path.read_text(), frozen.label))
    assert check_result(bundle, inline, benchmark=frozen).faults


def test_a_scene_more_or_less_is_found(bundle, file):
    frozen = read_benchmark(str(file))
    entries = json.loads((bundle / BUNDLE).read_text())
    entries[0]["episodes"] = 2
    (bundle / BUNDLE).write_text(json.dumps(entries))
    assert any("missing" in f for f in check_result(bundle, inline, benchmark=frozen).faults)


def test_different_benchmarks_are_not_compared(honest, file, tmp_path):
    other = tmp_path / "others.jsonl.xz"
    seeds = file.with_name("bells-seeds")
    words = ("freeze", *CELLS, "--scenes", 1, "--manifests", seeds, "--out", other, *HERE)
    command(*words)
    second = run(tmp_path / "second", other, "still")
    with pytest.raises(CompareError, match="on one"):
        read_arms([str(honest), str(second)])
    assert "which is not" in refused("results", honest, second, "--benchmark", file)
    with pytest.raises(BenchmarkError, match="another --out"):
        run(shutil.copytree(honest, tmp_path / "mixed"), other, "still")
