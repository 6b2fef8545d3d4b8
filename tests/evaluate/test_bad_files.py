"""Files that an evaluation reads, changed by somebody else: each is refused in one line that names
it."""

import json

import pytest

from pipeline.data.atomic import Busy, exclusive, write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Cell
from pipeline.evaluate.evaluate import Evaluation, evaluate
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import PolicyError
from pipeline.evaluate.scenes.manifests import (
    Manifest,
    Manifests,
    ProtocolError,
    first_seed,
    inline,
)
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.results import Results, ResultsError, check_episode
from pipeline.evaluate.serving.server import ServeError, ServerAddress
from tests.evaluate.environment.test_env import case_of

CELL = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
DEEP = b"[" * 100_000


def manifest_values():
    """A manifest's JSON values, without the hash that would find every change first."""
    case = case_of("click_bell")
    tried = case.spec.seed - first_seed(0) + 1
    refused = dict.fromkeys(range(first_seed(0), case.spec.seed), "dry_run: no_success")
    values = json.loads(
        Manifest(CELL, first_seed(0), tried=tried, cases=[case], refused=refused).to_json()
    )
    del values["sha256"]
    return values | {"schema": 3}


whole = pytest.fixture(manifest_values, scope="module", name="whole")


def changed(values, path, value):
    """A copy with another value at a path of keys; None takes the key away."""
    values = json.loads(json.dumps(values))
    inside = values
    for key in path[:-1]:
        inside = inside[key]
    if value is None:
        del inside[path[-1]]
    else:
        inside[path[-1]] = value
    return values


OTHERS = [
    (("schema",), 7),
    (("cell",), None),
    (("cell",), 3),
    (("cell", "level"), "1"),
    (("first",), "x"),
    (("tried",), -1),
    (("tried",), 1e300),
    (("tried",), 10**30),
    (("setup",), {"fps": "15x"}),
    (("refused",), [1]),
    (("refused",), {"one": "x"}),
    (("cases",), {"a": 1}),
    (("cases", 0), 5),
    (("cases", 0, "spec"), {"seed": 1}),
    (("cases", 0, "spec", "task"), "shake_bottle"),
    (("cases", 0, "spec", "seed"), 5),
    (("cases", 0, "motion", "segments"), []),
    (("cases", 0, "motion", "duration"), "long"),
    (("cases", 0, "frames"), "many"),
    (("cases", 0, "end"), 3),
    (("cases", 0, "setup", "clutter"), 5),
    (("cases", 0, "setup"), {"fps": 30}),
    (("more",), 1),
]
"""A path of keys in a manifest, and a value that cannot be there; None for a key that is
missing."""


@pytest.mark.parametrize(("path", "value"), OTHERS)
def test_a_manifest_that_is_none_is_named(tmp_path, whole, path, value):
    manifests = Manifests(tmp_path)
    write_atomic(manifests.path(CELL), json.dumps(whole).encode())
    assert len(manifests.read(CELL).cases) == 1
    write_atomic(manifests.path(CELL), json.dumps(changed(whole, path, value)).encode())
    with pytest.raises(ProtocolError, match="delete it to draw them again") as error:
        manifests.read(CELL)
    assert str(error.value).isprintable()


TEXTS = (b"", b"[]", b"7", b"{}", DEEP, b"\xff\xfe", b'{"schema": 3', b'{"a": 1, "a": 1}')


@pytest.mark.parametrize("text", TEXTS)
def test_text_that_is_no_manifest_is_named(tmp_path, text):
    manifests = Manifests(tmp_path)
    write_atomic(manifests.path(CELL), text)
    with pytest.raises(ProtocolError, match="is no manifest of seeds"):
        manifests.read(CELL)


def test_a_manifest_with_an_edited_motion_is_named(tmp_path):
    manifests, case = Manifests(tmp_path), case_of("click_bell")
    path = manifests.path(CELL)
    write_atomic(path, Manifest(CELL, case.spec.seed, tried=1, cases=[case]).to_json())
    values = json.loads(path.read_bytes())
    values["cases"][0]["motion"]["duration"] += 1.0
    write_atomic(path, json.dumps(values).encode())
    with pytest.raises(ProtocolError, match="its cases are not those that were written"):
        manifests.read(CELL)


KEY = json.dumps(["code", "p", "sim", "{}", "d", []])
ROW = {
    **dict.fromkeys(
        ("policy", "clock", "rules", "task", "embodiment", "domain", "category", "failure"), "x"
    ),
    **dict.fromkeys(("level", "alpha", "seed", "route_completion", "manipulation_score"), 1),
    **dict.fromkeys(("success", "same_start", "sees_truth"), True),
    "failed": [],
    "penalties": [],
    "key": KEY,
}


FIELDS = [
    ("key", 3),
    ("key", "x"),
    ("key", "[]"),
    ("key", "[" * 9000),
    ("key", json.dumps([1] * 6)),
    ("task", None),
    ("task", 3),
    ("success", "yes"),
    ("level", True),
    ("alpha", float("nan")),
    ("manipulation_score", 1e300),
    ("failed", "all"),
    ("failed", [{}]),
    ("sees_truth", 1),
]
"""A field of a row, and a value that it cannot have."""


@pytest.mark.parametrize(("key", "value"), FIELDS)
def test_a_row_of_something_else_is_named(tmp_path, key, value):
    path = tmp_path / "episodes.jsonl"
    path.write_text(json.dumps(ROW) + "\n")
    assert len(Results(path, check_episode).rows()) == 1
    path.write_text(json.dumps(ROW) + "\n" + json.dumps(ROW | {key: value}) + "\n")
    with pytest.raises(ResultsError, match="line 2 is no result") as error:
        Results(path, check_episode)
    assert str(error.value).isprintable() and len(str(error.value)) < 500


LINES = (b"7", b"[]", b"\xff", DEEP, b'{"a":1,"a":2}')


@pytest.mark.parametrize("line", LINES)
def test_a_line_that_is_no_row_is_named(tmp_path, line):
    (tmp_path / "episodes.jsonl").write_bytes(line + b"\n")
    with pytest.raises(ResultsError, match="line 1 is no result"):
        Results(tmp_path / "episodes.jsonl", check_episode)


@pytest.mark.parametrize("place", ["file", "file/inside"])
def test_a_file_in_place_of_a_directory_is_named_before_anything_happens(tmp_path, place):
    (tmp_path / "file").write_text("")
    wanted = Evaluation((CELL,), policy_name("random"), parse_clock("sim"), 1)
    for out, manifests in ((place, None), ("out", tmp_path / place)):
        with pytest.raises(NotADirectoryError, match="is no directory") as error:
            evaluate(wanted, tmp_path / out, lambda *given: pytest.fail("something ran"), manifests)
        assert error.value.filename == str(tmp_path / "file") and not (tmp_path / "out").exists()


def test_two_evaluations_do_not_write_one_directory(tmp_path):
    wanted = Evaluation((CELL,), policy_name("random"), parse_clock("sim"), 1)
    with exclusive(tmp_path), pytest.raises(Busy, match="another command is writing it"):
        evaluate(wanted, tmp_path, inline)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["manifests", "episodes.jsonl", "manifests/seed0"])
def test_results_with_links_are_refused_before_anything_is_written(tmp_path, name):
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    (out / name).parent.mkdir(parents=True)
    (out / name).symlink_to(elsewhere)
    wanted = Evaluation((CELL,), policy_name("random"), parse_clock("sim"), 1)
    with pytest.raises((OSError, DominoError), match="is a link"):
        evaluate(wanted, out, inline)
    assert not list(elsewhere.iterdir())


def test_a_policy_is_loaded_before_any_scene_is_admitted(tmp_path, monkeypatch):
    monkeypatch.setattr(Manifests, "admitted", lambda *given: pytest.fail("scenes were admitted"))
    (tmp_path / "bad.py").write_text("def make_policy(:")
    wanted = Evaluation((CELL,), policy_name(str(tmp_path / "bad.py")), parse_clock("sim"), 1)
    with pytest.raises(PolicyError, match="SyntaxError"):
        evaluate(wanted, tmp_path / "out", inline)
    assert not (tmp_path / "out").exists()


ARGUMENTS = ("nan", "inf", "-1", "1e30", "", "0x10", "9" * 30, "1=2", "true")


@pytest.mark.parametrize("value", ARGUMENTS)
def test_arguments_of_policies_are_plain_numbers(value):
    for text in (
        f"replay:chunk={value}",
        f"interceptor:noise={value}",
        f"interceptor:delay={value}",
    ):
        with pytest.raises(DominoError) as error:
            make_policy(policy_name(text))
        assert str(error.value).isprintable()


HOSTS = (
    "a" * 64,
    "a..b",
    "a b",
    "a\x00b",
    "\u00fc" * 80,
    "[::1",
    "1.2.3.4.5/x",
    "a" * 300,
    "[fe80::1%\x1b]",
)


@pytest.mark.parametrize("host", HOSTS)
def test_hosts_are_names_of_machines(host):
    with pytest.raises(PolicyError) as error:
        policy_name(f"ws://{host}:80")
    assert str(error.value).isprintable()
    if host not in ("a" * 64, "a..b"):
        with pytest.raises(ServeError):
            ServerAddress(host, token="x" * 20)
