"""`view` in a terminal and in a pipe."""

import os
import pty
import re
import signal
import subprocess
import urllib.request

import pytest

from pipeline.data.atomic import exclusive
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import parse_recipe
from tests.run.command import COMMAND, ROOT, inside
from tests.synthetic import make_episode

RECIPE = parse_recipe({"tasks": "click_bell", "levels": 1, "episodes": 2})


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    dataset = Dataset(tmp_path_factory.mktemp("viewed") / "set")
    dataset.create(RECIPE)
    for number, slot in enumerate(RECIPE.slots()):
        make_episode(dataset.episode(slot), slot=number, seed=number, level=1, frames=3)
    return dataset.root


def test_a_terminal_is_served_until_ctrl_c(root):
    ours, theirs = pty.openpty()
    hidden = ("CI", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {k: v for k, v in os.environ.items() if k not in hidden}
    process = subprocess.Popen(
        # a shell makes what it starts in the background ignore SIGINT
        ["env", "--default-signal=INT", COMMAND, "view", root],
        **dict.fromkeys(("stdin", "stdout", "stderr"), theirs),
        env=environment | {"PYTHONPATH": str(ROOT)},
    )
    os.close(theirs)
    said = b""
    while not (found := re.search(rb"(http://127.0.0.1:\d+/)", said)):
        said += os.read(ours, 1000)
    with urllib.request.urlopen(found[1].decode() + "list.js") as answer:
        assert answer.read().count(b".hdf5") == 2
    process.send_signal(signal.SIGINT)  # as Ctrl-C does
    assert process.wait(60) == 0
    os.close(ours)
    assert not (root / "report").exists()


def test_elsewhere_the_page_is_written(root, tmp_path):
    code, out, err = inside("view", root, "--quiet", "--out", tmp_path / "pages")
    assert code == 0, err
    assert out.split() == [str(tmp_path / "pages" / "index.html")]
    code, out, err = inside("view", root, "--quiet")
    assert (code, out.split()) == (0, [str(root / "report" / "view" / "index.html")]), err


def test_a_page_that_another_view_writes_is_left_alone(root, tmp_path):
    pages = tmp_path / "pages"
    pages.mkdir()
    with exclusive(pages):
        code, _, err = inside("view", root, "--quiet", "--out", pages)
    assert code == 2 and "another command" in err and not [*pages.iterdir()]
