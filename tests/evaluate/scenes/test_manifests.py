"""Admitted seeds, results on disk, policies by name: without the simulator, where it does not
matter."""

import json
from dataclasses import replace

import pytest

from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import PolicyError, chunk_of
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.manifests import (
    Manifest,
    Manifests,
    ProtocolError,
    first_seed,
    most_tries,
)
from pipeline.evaluate.scoring.results import Results, ResultsError
from pipeline.motion.planar import PlanarMotion

CELL = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
OTHER = replace(CELL, level=3)
MOTION = PlanarMotion.still([0.1, 0.2, 0.74, 1, 0, 0, 0], 2.0).to_json()


def pretend(solved, calls=None):
    """A runner that has an expert who solves the seeds for which `solved` holds; jobs end in
    reverse order."""

    def run(work, jobs):
        for job in reversed(list(jobs)):
            if calls is not None:
                calls.append((job.cell.level, job.seed))
            yield (
                job,
                (
                    Case(job.spec, MOTION, 2.0, 30, "s", "e")
                    if solved(job.seed)
                    else "dry_run: no_success"
                ),
            )

    return run


def seeds(cases):
    return [case.spec.seed for case in cases]


def test_the_first_seeds_that_the_expert_solves_are_admitted(tmp_path):
    manifests, calls = Manifests(tmp_path, seed=1), []
    found = manifests.admitted([CELL, OTHER], 4, pretend(lambda seed: seed % 3 != 0, calls))
    assert first_seed(1) == 200_000
    # 200001 is divisible by 3
    assert seeds(found[CELL]) == [200_000, 200_002, 200_003, 200_005]
    assert seeds(found[OTHER]) == seeds(found[CELL])
    assert len(calls) == len(set(calls)) == 12
    assert manifests.read(CELL).refused == {
        200_001: "dry_run: no_success",
        200_004: "dry_run: no_success",
    }


def test_alphas_apart_have_scenes_of_their_own(tmp_path):
    manifests, slow = Manifests(tmp_path, apart=True), replace(CELL, alpha=0.05)
    found = manifests.admitted([CELL, slow], 2, pretend(lambda seed: True))
    assert not set(seeds(found[CELL])) & set(seeds(found[slow]))
    assert found == manifests.admitted(
        [CELL, slow], 2, pretend(lambda seed: pytest.fail("tried again"))
    )
    assert Manifests(tmp_path).path(CELL) != manifests.path(CELL)


def test_a_manifest_is_used_again_and_extended_in_order(tmp_path):
    manifests, calls = Manifests(tmp_path), []
    manifests.admitted([CELL], 2, pretend(lambda seed: True))
    assert seeds(manifests.admitted([CELL], 2, pretend(lambda seed: True, calls))[CELL]) == [
        100_000,
        100_001,
    ]
    assert calls == []
    assert (
        seeds(manifests.admitted([CELL], 3, pretend(lambda seed: True, calls))[CELL])[-1] == 100_002
    )
    assert calls == [(1, 100_002)]
    text = manifests.path(CELL).read_bytes()
    assert Manifest.from_json(text).to_json() == text
    assert json.loads(text)["cases"][0]["spec"]["seed"] == 100_000


def test_admission_is_bounded(tmp_path):
    calls = []
    with pytest.raises(ProtocolError, match=r"solves 0 of 26 seeds, fewer than the 2 wanted"):
        Manifests(tmp_path).admitted([CELL], 2, pretend(lambda seed: False, calls))
    assert len(calls) == most_tries(2) == 26


@pytest.mark.parametrize("damage", [b"{", b"[]", b'{"schema": 9}', b'{"schema": 1, "cases": [{}]}'])
def test_a_file_that_is_no_manifest_is_named(tmp_path, damage):
    manifests = Manifests(tmp_path)
    path = manifests.path(CELL)
    path.parent.mkdir(parents=True)
    path.write_bytes(damage)
    with pytest.raises(ProtocolError, match="delete it"):
        manifests.read(CELL)


def test_a_manifest_of_another_cell_is_refused(tmp_path):
    manifests = Manifests(tmp_path)
    manifests.admitted([OTHER], 1, pretend(lambda seed: True))
    manifests.path(OTHER).rename(manifests.path(OTHER).with_name("x"))
    manifests.path(CELL).parent.mkdir(parents=True)
    manifests.path(OTHER).with_name("x").rename(manifests.path(CELL))
    with pytest.raises(ProtocolError, match="another cell"):
        manifests.read(CELL)


# --- results
# ------------------------------------------------------------------------------------------


def test_a_line_that_was_cut_off_is_dropped_and_written_again(tmp_path):
    path = tmp_path / "r" / "episodes.jsonl"
    results = Results(path)
    results.append("a", {"success": True})
    results.append("b", {"success": False})
    whole = path.read_bytes()
    path.write_bytes(whole[:-7])
    again = Results(path)
    assert "a" in again
    assert "b" not in again
    again.append("b", {"success": False})
    assert path.read_bytes() == whole
    assert [row["success"] for row in Results(path).of(["b", "nothing", "a"])] == [False, True]


def test_a_damaged_line_is_named(tmp_path):
    path = tmp_path / "episodes.jsonl"
    path.write_text('{"key":"a"}\nrubbish\n')
    with pytest.raises(ResultsError, match="line 2"):
        Results(path)


def test_rows_that_contradict_each_other_are_refused_and_so_is_another_writer(tmp_path):
    path = tmp_path / "episodes.jsonl"
    results = Results(path)
    results.append("a", {"success": False, "seconds_spent": {"policy": 1.0}})
    with path.open("a") as file:
        file.write('{"key":"a","success":false,"seconds_spent":{"policy":2.0}}\n')
    assert len(Results(path).rows()) == 1
    with pytest.raises(ResultsError, match="something else writes to it"):
        results.append("b", {"success": True})
    with path.open("a") as file:
        file.write('{"key":"a","success":true,"seconds_spent":{}}\n')
    with pytest.raises(ResultsError, match="line 3 contradicts an earlier row"):
        Results(path)


# --- policies
# ------------------------------------------------------------------------------------------


def test_built_in_policies_take_numbers():
    make_policy(policy_name("interceptor:noise=0.01,delay=0.2"))
    with pytest.raises(PolicyError, match="unknown"):
        policy_name("pi7")
    with pytest.raises(PolicyError, match="key=number"):
        policy_name("interceptor:noise")
    with pytest.raises(PolicyError, match=r"wisdom.* noise, delay, chunk"):
        policy_name("interceptor:wisdom=3")


def test_a_file_makes_a_policy_and_carries_its_hash(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(
        "class P:\n    def reset(self, start): pass\n    def act(self, o): return o.joints\ndef"
        " make_policy(): return P()\n"
    )
    name = policy_name(str(path))
    assert name.label.startswith("mine.py@")
    assert hasattr(make_policy(name), "act")
    path.write_text(path.read_text() + "\n")
    assert policy_name(str(path)).label != name.label


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "make_policy"), ("1/0", "ZeroDivisionError"), ("def make_policy(): return 3", "reset")],
)
def test_a_file_that_makes_none_is_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "bad.py"
    path.write_text(text)
    with pytest.raises(PolicyError, match=said) as error:
        make_policy(policy_name(str(path)))
    assert "\n" not in str(error.value)
    with pytest.raises(PolicyError, match="cannot be read"):
        policy_name(str(tmp_path / "nothing.py"))


def test_answers_are_actions_or_chunks():
    assert chunk_of([1.0, 2.0], 2).shape == (1, 2)
    assert chunk_of([[1.0, 2.0]] * 7, 2).shape == (7, 2)
    for bad in ([], [[]], [[[1.0, 2.0]]], 3.0, [[1.0, 2.0]] * 1001, [1.0], [[1.0, float("inf")]]):
        with pytest.raises(ActionError):
            chunk_of(bad, 2)


def test_cases_are_told_apart_by_their_motion():
    case = Case(
        EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 3), MOTION, 2.0, 30, "s", "e"
    )
    moved = PlanarMotion.still([0.1, 0.3, 0.74, 1, 0, 0, 0], 2.0).to_json()
    assert case.digest != replace(case, motion=moved).digest
    assert Case.from_dict(json.loads(json.dumps(case.to_dict()))) == case
