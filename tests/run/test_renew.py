"""Editing sources and building again: only what an edit can change is made again, and it has the
bytes of a build from nothing."""

import json
import shutil
from pathlib import Path

import h5py
import pytest

from pipeline.run.identity import core
from pipeline.run.identity import slot_keys as code
from pipeline.tasks import TASKS
from tests.run.command import inside
from tests.run.identity.sources import hashing_once
from tests.run.identity.test_slot_keys import CODE

WANTED = ("--manifest", Path(__file__).with_name("smallest.yaml"))
PHRASE = "Would {arm} be so kind as to ring {bell}?"


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A copy of the sources to edit, from which this process takes its keys. It runs the sources
    themselves: no edit of the test but that of the phrases does anything."""
    root = shutil.copytree(
        core.PACKAGE, tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__")
    )
    monkeypatch.setattr(core, "PACKAGE", root)
    monkeypatch.setattr(core, "hash_file", hashing_once())
    yield root
    monkeypatch.undo()
    forget_sources()


def forget_sources():
    """Make this process read all sources again, as a new one would."""
    for cached in (code.cell_code, code.drawing_code, core.hash_files, core.hash_file):
        cached.cache_clear()


def say(*commands):
    """What each of some commands prints as JSON, run one after another on the edited sources."""
    forget_sources()
    return [json.loads(inside(*words, "--json")[1]) for words in commands]


def building(out):
    return "build", *WANTED, "--executor", "inline", "--quiet", "--out", out


def edit(tree, file, text):
    path = tree / file
    path.write_text(path.read_text() + text)


def contents(out):
    return {
        p.relative_to(out).as_posix(): p.read_bytes()
        for p in sorted(out.glob("episodes/**/*.hdf5"))
    }


def arrays(out):
    """All arrays of all episodes but the sentences, and the sentences."""
    kept, spoken = {}, {}
    for path in sorted(out.glob("episodes/**/*.hdf5")):
        with h5py.File(path) as f:

            def visit(name, item, path=path):
                if isinstance(item, h5py.Dataset):
                    where = spoken if name.startswith("instruction") else kept
                    where[path.parts[-5], name] = (
                        item[()]
                        if item.dtype.kind == "O" and not item.shape
                        else item[()].tolist()
                        if item.dtype.kind == "O"
                        else item[()].tobytes()
                    )

            f.visititems(visit)
    return kept, spoken


@pytest.mark.usefixtures("without_report")
def test_edits_redo_only_what_they_can_change(tree, tmp_path, monkeypatch):
    out, bell = tmp_path / "out", type(TASKS["click_bell"])
    (first_build,) = say(building(out))
    assert first_build["parts"] == {"open": 2}
    first, spoken = arrays(out)

    # phrases: no physics and no rendering, only that task's sentences; another task: its slot, and
    # to the same bytes
    edit(tree, "tasks/library/domino/press/phrases/click_bell.txt", f"{PHRASE}\n")
    monkeypatch.setattr(bell, "unseen", (*bell.unseen, PHRASE))
    edit(tree, "tasks/library/domino/handle/set_aside.py", CODE)
    told, built = say(("status", out), building(out))
    assert {(redo["what"], *redo["because"], redo["slots"]) for redo in told["redo"]} == {
        ("sentences", "phrases", 1),
        ("physics", "task", 1),
    }
    assert built["parts"] == {"sentences": 1, "physics": 1}
    kept, words = arrays(out)
    assert kept == first
    changed = {key for key in words if words[key] != spoken[key]}
    assert (
        changed <= {("click_bell", "instruction/unseen"), ("click_bell", "instruction/seen")}
        and changed
    )

    # the renderer: all images from the stored logs; a remark, a third task and a listing: nothing
    edit(tree, "world/drawing/renderer.py", CODE)
    edit(tree, "tasks/library/domino/handle/shake_bottle.py", CODE)
    edit(tree, "intake/catalogue/listings.py", CODE)
    edit(tree, "world/physics/simulation.py", "\n# a remark\n")
    told, built, again, checked, _ = say(
        ("status", out),
        building(out),
        building(out),
        ("verify", out),
        building(tmp_path / "nothing"),
    )
    assert told["redo"] == [{"what": "images", "because": ["renderer"], "slots": 2}]
    assert (built["parts"], again["parts"]) == ({"images": 2}, {})
    assert checked["ok"]
    assert arrays(out) == (kept, words)
    assert contents(out) == contents(tmp_path / "nothing")
