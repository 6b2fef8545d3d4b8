"""Nothing that a dataset's manifest names is executed without --trust."""

import os
import pickle
from pathlib import Path

import numpy as np
import pytest

import domino_data as dd
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Corrections
from pipeline.data.slots.assets import AssetError, AssetStore
from pipeline.run.names import Untrusted, check_trust
from tests.run.command import inside

CODE = """
import os
from pathlib import Path
Path({canary!r}).write_text(str(os.getpid()))
raise RuntimeError("ran")
"""
TINY = {"tasks": ("click_bell",), "levels": (1,), "episodes": 1, "cameras": ("head",)}


@pytest.fixture
def received(tmp_path: Path) -> Path:
    """A dataset whose recipe names a policy beside it, which leaves a canary when it runs."""
    policy = tmp_path / "policy.py"
    policy.write_text(CODE.format(canary=str(tmp_path / "canary")))
    root = tmp_path / "received"
    corrections = {"policy": str(policy), "label": "policy.py@00000000"}
    Dataset(root).create(Recipe.model_validate(TINY | {"corrections": corrections}))
    return root


class Runs:
    """Leaves the canary when it is unpickled."""

    def __reduce__(self):
        return os.system, ("touch canary",)


def test_what_a_dataset_stores_is_data(received, monkeypatch):
    """No pickle in an asset, no tag in the manifest, no code in the index or beside the files."""
    monkeypatch.chdir(received.parent)
    store = AssetStore(received / "assets/bodies")
    path = store.path("0" * 32)
    path.parent.mkdir(parents=True)
    np.savez(path, x=np.array([Runs()], dtype=object))
    with pytest.raises(AssetError):
        store.get("0" * 32)
    Path("tags.yaml").write_text("tasks: !!python/object/apply:os.system [touch canary]\n")
    assert inside("plan", "--manifest", "tags.yaml")[0] == 2
    (received / "index.sqlite").write_bytes(pickle.dumps(Runs()))
    for name in ("conftest.py", "sitecustomize.py", "pipeline.py", "h5py.py", "policy.py"):
        (received / name).write_text("open('canary', 'w')")
    monkeypatch.chdir(received)
    assert inside("status", ".")[0] == 0
    assert inside("verify", ".", "--executor", "inline")[0] == 1  # the asset is damaged
    assert not Path("canary").exists() and not Path("../canary").exists()


VERBS = {
    "verify one": ("verify", "--episode", "click_bell/aloha-agilex/L1/clean/episode_0000000"),
    "verify": ("verify", "--again", "1", "--executor", "inline"),
    "build": ("build", "--executor", "inline", "--out", "NEW", "--like"),
    "plan": ("plan", "--measure", "--like"),
}


@pytest.mark.parametrize("verb", VERBS)
def test_code_that_a_dataset_names_needs_trust(verb, received, monkeypatch):
    monkeypatch.chdir(received.parent)
    code, out, err = inside(*VERBS[verb], received)
    assert (code, out, err.count("\n")) == (2, "", 1) and "--trust" in err and "policy.py" in err
    assert not (received.parent / "canary").exists() and not (received.parent / "NEW").exists()


def test_code_of_a_setup_beside_a_checkpoint_needs_trust(received, monkeypatch):
    monkeypatch.chdir(received.parent)
    Path("checkpoint").mkdir()
    Path("checkpoint/setup.yaml").write_text("corrections: {policy: policy.py}\n")
    code, _, err = inside(*VERBS["build"], "checkpoint")
    assert code == 2 and "--trust" in err and not Path("canary").exists()


def test_a_file_is_not_taken_for_a_policy_of_ours(received, monkeypatch):
    monkeypatch.chdir(received.parent)
    Path("chaser:policy.py").write_text(Path("policy.py").read_text())
    for policy in ("chaser:policy.py", "chaser:/../policy.py"):
        with pytest.raises(Untrusted):
            check_trust(Corrections(policy=policy), "received")
    check_trust(Corrections(policy="interceptor:noise=0.01"), "received")


def test_trusted_code_runs_in_a_process_of_its_own(received, monkeypatch):
    monkeypatch.chdir(received.parent)
    code, _, err = inside(*VERBS["build"], received, "--trust")
    assert code == 2 and "ran" in err and err.count("\n") == 1
    assert int(Path("canary").read_text()) != os.getpid()


def test_a_manifest_that_the_user_names_is_the_users_own(received, monkeypatch):
    monkeypatch.chdir(received.parent)
    code, _, err = inside(*VERBS["build"][:-1], "--manifest", received / "manifest.yaml")
    assert code == 2 and "ran" in err and Path("canary").exists()


def test_an_evaluation_like_a_dataset_runs_no_policy_of_it(received, monkeypatch):
    monkeypatch.chdir(received.parent)
    code, _, err = inside(
        *("evaluate", "--policy", "no_such_policy", "--like", received, "--out", "results")
    )
    assert code == 2 and "no_such_policy" in err and not Path("canary").exists()


def test_the_api_asks_for_trust_too(received):
    with pytest.raises(dd.DominoError, match="--trust"):
        dd.verify(received, again=1)
    assert not (received.parent / "canary").exists()
    assert dd.verify(received)["ok"]
