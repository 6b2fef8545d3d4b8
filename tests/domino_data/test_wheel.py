"""The built wheel, installed as a tool into an environment of its own, builds an episode from any
directory."""

import os
import re
import shutil
import subprocess
import sys
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


def test_the_wheel_builds_an_episode_from_any_directory(tmp_path):
    run(UV, "build", "--wheel", "--out-dir", tmp_path / "dist", cwd=ROOT)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    # the packages of pyproject.toml that must stay out of an environment
    overrides = re.search(
        r"^override-dependencies = \[(.*)\]$", (ROOT / "pyproject.toml").read_text(), re.MULTILINE
    )
    assert overrides
    (tmp_path / "overrides.txt").write_text("\n".join(re.findall(r'"([^"]+)"', overrides[1])))
    python = Path(sys.executable).resolve()
    places = {"UV_TOOL_DIR": tmp_path / "tools", "UV_TOOL_BIN_DIR": tmp_path / "bin"}
    run(
        UV,
        "tool",
        "install",
        "--python",
        python,
        "--overrides",
        tmp_path / "overrides.txt",
        wheel,
        cwd=tmp_path,
        **places,
    )

    def domino(*words: object) -> str:
        return run(tmp_path / "bin" / "domino-data", *words, cwd=tmp_path)

    assert "episodes: 36\n" in domino("plan", "--manifest", "smoke")
    domino(
        "build",
        "--tasks",
        "click_bell",
        "--levels",
        "1",
        "--episodes",
        "1",
        "--out",
        "bells",
        "--workers",
        "1",
        "--quiet",
    )
    assert len(list(tmp_path.glob("bells/episodes/**/*.hdf5"))) == 1
    assert "index.html" in domino("view", "bells", "--quiet")
