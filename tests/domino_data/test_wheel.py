"""The built wheel, installed as a tool into an environment of its own, builds an episode from any
directory."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UV = shutil.which("uv") or shutil.which("uv", path=ROOT / ".tools" / "bin")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(UV is None, reason="uv is not installed (make setup)"),
]


def run(*words: object, cwd: Path, **variables: object) -> str:
    """Run a program outside of the checkout; its standard output."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    environment |= {name: str(value) for name, value in variables.items()}
    done = subprocess.run(
        [*map(str, words)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
    )
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel made from the source archive, as `uv build` makes it."""
    out = tmp_path_factory.mktemp("dist")
    run(UV, "build", "--out-dir", out, cwd=ROOT)
    assert len(list(out.glob("*.tar.gz"))) == 1
    (found,) = out.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def domino(wheel, tmp_path_factory):
    """The command of the wheel, installed as a tool with what its metadata asks for; it runs in a
    directory and returns its output."""
    home = tmp_path_factory.mktemp("tools")
    places = {"UV_TOOL_DIR": home / "tools", "UV_TOOL_BIN_DIR": home / "bin"}
    python = Path(sys.executable).resolve()
    run(UV, "tool", "install", "--python", python, wheel, cwd=home, **places)
    return lambda *words, cwd: run(home / "bin" / "domino-data", *words, cwd=cwd)


def test_the_wheel_makes_the_demo_in_any_directory(domino, tmp_path):
    said = domino("demo", "--no-view", "--quiet", cwd=tmp_path).splitlines()
    assert len(list(tmp_path.glob("domino-demo/episodes/**/*.hdf5"))) == 2
    page = said[0].split("file://")[1]
    assert Path(page).is_file() and len(said) == 6
    domino("export", "domino-demo", "--format", "lerobot", "--quiet", cwd=tmp_path)
    assert (tmp_path / "domino-demo/exports/lerobot/meta/info.json").is_file()


def test_the_wheel_has_its_recipes_robots_and_types(domino, wheel, tmp_path):
    assert "episodes: 36\n" in domino("plan", "--manifest", "smoke", cwd=tmp_path)
    assert "franka-panda" in domino("embodiments", cwd=tmp_path)
    assert "domino_data/py.typed" in zipfile.ZipFile(wheel).namelist()


def test_uvx_runs_the_wheel(wheel, tmp_path):
    python = Path(sys.executable).resolve()
    words = ("--python", python, "--from", wheel, "domino-data", "--version")
    assert run(UV, "tool", "run", *words, cwd=tmp_path).startswith("domino-data ")
