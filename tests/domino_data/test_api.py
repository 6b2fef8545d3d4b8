"""The public package: what its page shows runs as written, its import is cheap, and foreign
packages are refused."""

import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import domino_data
from domino_data_command import PACKAGES
from pipeline.gym_ids import shipped_tasks
from pipeline.tasks.contract import expand_tasks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "python_api.md"
SMALL = "size=(64, 48), render='raster-fast'"
"""What the test adds to the recipe of the page: images that are drawn in less time."""
COMMAND = "import domino_data_command; domino_data_command.main()"


def python(code: str, *paths: Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own, with these directories first on the path."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [*paths, ROOT]))}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env=environment, cwd=cwd, capture_output=True, text=True, check=False, timeout=120
    )


def test_the_page_runs_as_written(tmp_path, monkeypatch, capsys):
    example = tmp_path / "example.py"
    code = "".join(re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL))
    example.write_text(code.replace("episodes=1)", f"episodes=1, {SMALL})", 1))
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location("example", example)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "example", module)
    spec.loader.exec_module(module)
    assert (
        module.result.accepted == 1
        and module.state.shape[1] == len(module.observation["agent_pos"]) == 14
    )
    assert (
        module.summary["format"] == "parquet"
        and (tmp_path / "bells/exports/parquet/export.json").exists()
    )
    everything = domino_data.export(tmp_path / "bells", "parquet", tmp_path / "all")
    assert everything["episodes"] == module.summary["episodes"] == 1
    assert module.outcome.cells[0]["success_rate"] == 0 and module.outcome.page.exists()
    assert module.outcome.cells[0]["faults"] == {}
    assert "no task 'click_bel'" in capsys.readouterr().out.splitlines()[-1]
    assert not (tmp_path / "none").exists()


def test_every_public_name_is_there_documented_and_on_the_page():
    text = PAGE.read_text()
    for name in domino_data.__all__:
        item = getattr(domino_data, name)
        assert inspect.getdoc(item), name
        assert f"`{name}" in text or f"`{name}(" in text, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = domino_data.nothing


def test_the_import_registers_all_tasks_and_loads_nothing_heavy():
    heavy = ("sapien", "torch", "ray", "numba", "scipy", "cv2", "h5py", "pyarrow", "pydantic")
    code = (
        f"import json, sys; import domino_data, gymnasium; print(json.dumps([[m for m in {heavy} if"
        " m in sys.modules], [i for i in gymnasium.registry if i.startswith('domino/')]]))"
    )
    loaded, ids = json.loads(python(code).stdout)
    assert loaded == []
    assert ids == [f"domino/{task}-v0" for task in shipped_tasks()]
    assert shipped_tasks() == sorted(expand_tasks(["all"]))


@pytest.mark.parametrize("name", PACKAGES)
def test_a_foreign_package_of_our_name_is_refused_in_one_line(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").touch()
    done = python(COMMAND, tmp_path, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert (
        done.stderr.startswith(f"domino-data: the package `{name}` of domino-data is not")
        and str(tmp_path / name) in done.stderr
    )
    assert (
        f"ImportError: the package `{name}`"
        in python("import domino_data", tmp_path, cwd=tmp_path).stderr
    )


def test_a_recipe_that_ships_is_known_by_its_name_in_any_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    slots = [
        domino_data.plan(name)["slots"]
        for name in ("smoke", "manifests/smoke.yaml", "paper/10-tasks")
    ]
    assert slots == [36, 36, 500]
