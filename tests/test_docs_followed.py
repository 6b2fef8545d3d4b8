"""The pages that add something are followed block by block, as written, in a new directory: files
are saved, commands are run."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.intake.objects.meshes import mug_file, robotwin_mug
from tests.run.command import ROOT, build
from tests.run.processes import wait_for

pytestmark = pytest.mark.slow

BLOCK = re.compile(
    r"^(?P<before>(?:[^\n]+\n)*)\n?^```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
SAVED = re.compile(r"[Ss]aved as\s+`([\w/.]+)`")


@dataclass(frozen=True)
class Block:
    """A block of a page: its kind, its text, and the file that the paragraph before says to save it
    as."""

    kind: str
    text: str
    file: str | None


def blocks(page: Path) -> list[Block]:
    """The blocks of a page in order."""
    found = []
    for match in BLOCK.finditer(page.read_text()):
        saved = SAVED.findall(match["before"])
        found.append(Block(match["kind"], match["text"], saved[-1] if saved else None))
    return found


@pytest.fixture
def checkout(tmp_path):
    """A new directory with the package, its tests and its environment, and a home."""
    tree = tmp_path / "checkout"
    for name in ("domino_data", "pipeline", "training", "tests", "manifests", "lerobot_env_domino"):
        shutil.copytree(ROOT / name, tree / name)
    for name in ("pyproject.toml", "domino_data_command.py"):
        shutil.copy(ROOT / name, tree)
    (tree / ".venv").symlink_to(Path(sys.executable).parents[1])
    (tmp_path / "home").mkdir()
    return tree


def environment(tree: Path) -> dict[str, str]:
    """Variables of a shell in the new directory."""
    place = {
        "PYTHONPATH": str(tree),
        "PATH": f"{tree}/.venv/bin:{os.environ['PATH']}",
        "HOME": str(tree.parent / "home"),
    }
    # the test runner of the page's own command must not take this one's workers for its own
    return {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")} | place


def shell_lines(page: Path) -> list[str]:
    """Lines of the shell blocks of a page, in order, continuations joined."""
    return [
        line
        for block in blocks(page)
        if block.kind == "sh"
        for line in block.text.replace("\\\n", " ").splitlines()
    ]


def run(line: str, tree: Path, patience: float = 400) -> None:
    """Run a line of a page; it must succeed."""
    command = ["bash", "-c", line]
    done = subprocess.run(
        command,
        cwd=tree,
        env=environment(tree),
        capture_output=True,
        text=True,
        timeout=patience,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def follow(page: str, tree: Path) -> list[str]:
    """Save what is to be saved and run every line of the shell blocks, in the order of the page;
    the lines that were run."""
    path = ROOT / "docs" / page
    for block in blocks(path):
        if block.file:
            (tree / block.file).parent.mkdir(parents=True, exist_ok=True)
            (tree / block.file).write_text(block.text)
        elif block.kind == "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                run(line, tree)
    return shell_lines(path)


def test_the_page_on_tasks(checkout):
    ran = follow("add_a_task.md", checkout)
    assert [line.split()[1:3] for line in ran[:2]] == [
        ["check-task", "lift_can"],
        ["check-task", "stand_can_pad"],
    ]
    assert len(list((checkout / "out/check/episodes").rglob("*.hdf5"))) == 2


def test_the_page_on_objects(checkout):
    robotwin_mug(checkout / "assets/objects/039_mug", mug_file(checkout / "mug.glb"))
    follow("add_an_object.md", checkout)
    for name in ("mine", "robotwin"):
        assert len(list((checkout / f"out/{name}/episodes").rglob("*.hdf5"))) == 1
    assert "eraser" in (checkout / "out/eraser.html").read_text()


def test_the_page_on_robots(checkout):
    ours = checkout / "pipeline/assets/robots/piper"
    (checkout.parent / "home/vendor").mkdir(parents=True)
    (checkout.parent / "home/vendor/my_arm.urdf").write_text((ours / "robot.urdf").read_text())
    shutil.copytree(ours / "meshes", checkout.parent / "home/vendor/meshes")
    shutil.copytree(ours, checkout / "embodiments/their-arm")
    follow("add_a_robot.md", checkout)
    assert [
        len(list((checkout / "out" / name / "episodes").rglob("*.hdf5")))
        for name in ("mine", "one-arm")
    ] == [1, 1]


def test_the_page_on_formats(checkout):
    build(checkout / "out/mine", "--levels", "1", "--executor", "inline")
    follow("add_a_format.md", checkout)
    assert [p.name for p in (checkout / "out/mine/exports/npz").glob("*.npz")] == ["episode_0.npz"]


def test_the_page_on_recipes(checkout):
    follow("recipes.md", checkout)
    assert len(list((checkout / "out/bells/episodes").rglob("*.hdf5"))) == 2


def test_the_notebook(checkout):
    cells = json.loads((ROOT / "docs/first_hour.ipynb").read_text())["cells"]
    source = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    (checkout / "first_hour.py").write_text("import matplotlib\n\nmatplotlib.use('agg')\n" + source)
    run("python first_hour.py", checkout, 1200)
    assert (checkout / "first_hour/scores/index.html").exists()


def test_the_readme(checkout):
    lines = shell_lines(ROOT / "README.md")
    assert lines[:2] == ["make build", "source .venv/bin/activate"]
    # what `make build` makes, without the set-up
    run("domino-data build --tasks click_bell --levels 1 --episodes 2 --out out/first", checkout)
    stopped = []
    for line in lines[2:]:
        if line.endswith("--out out/mine"):  # all tasks: hours
            stop_after_an_episode(line, checkout)
            stopped.append(line)
        else:
            run(line.removesuffix(" --open"), checkout, 1200)
    assert len(stopped) == 1
    (example,) = [block.text for block in blocks(ROOT / "README.md") if block.kind == "python"]
    (checkout / "example.py").write_text(example)
    run("python example.py | grep -c click_bell | grep -x 2", checkout)
    assert (checkout / "out/first/exports/lerobot/meta/info.json").exists()
    assert (checkout / "out/evaluated/episodes.jsonl").exists()


def test_the_quickstart(checkout):
    lines = [line for line in shell_lines(ROOT / "docs/quickstart.md") if line != "make build"]
    stopped = []
    for line in lines:
        # draws every episode twice at four times the pixels
        if line.startswith("domino-data render "):
            stop_after_an_episode(line, checkout)
            stopped.append(line)
        else:
            run(line, checkout, 1200)
    assert len(stopped) == 1
    assert len(list((checkout / "out/two/episodes").rglob("*.hdf5"))) >= 23
    assert (checkout / "out/two/exports/lerobot/meta/info.json").exists()
    assert (checkout / "out/evaluated-rules/episodes.jsonl").exists()


def stop_after_an_episode(line: str, tree: Path) -> None:
    """Start a long build, interrupt it as Ctrl-C does when there is an episode, and see that it
    stops and can go on."""
    words = line.split()
    out = tree / words[words.index("--out") + 1]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(
        ["bash", "-c", line], cwd=tree, env=environment(tree), start_new_session=True, **pipes
    )
    try:
        wait_for(lambda: process.poll() is not None or any(out.glob("episodes/**/*.hdf5")), 600)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130 and b"rerun the same command to resume" in err, err.decode()
    run(f"domino-data verify {out}", tree)
