"""A task, an object, a motion, an exporter and a policy in a directory outside the package: what it
takes to use them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline.data.errors import DominoError
from pipeline.plugins import PLUGINS, load_plugins
from pipeline.world.objects import FAMILIES

EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "extension"


def domino(*words: object, plugins: Path | None = None) -> str:
    """What a command prints; a process of its own, so that plugins stay in it. Raises
    CalledProcessError."""
    command = [
        sys.executable,
        "-m",
        "pipeline.cli",
        *map(str, words),
        *(["--plugins", str(plugins)] if plugins else []),
    ]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def refused(*words: object, plugins: Path | None = None) -> str:
    """The line, after those of the progress, with which a command is refused."""
    with pytest.raises(subprocess.CalledProcessError) as failed:
        domino(*words, plugins=plugins)
    assert failed.value.returncode == 2
    assert "Traceback" not in failed.value.stderr
    *_, line = failed.value.stderr.splitlines()
    return line


@pytest.fixture
def loaded(monkeypatch, tmp_path):
    """Loads a directory, and forgets it and its modules afterwards."""
    path = list(sys.path)

    def load(directory: Path) -> None:
        monkeypatch.setenv(PLUGINS, str(directory))
        load_plugins()

    yield load
    sys.path[:] = path
    for name in [
        name
        for name, module in sys.modules.items()
        if str(tmp_path) in str(getattr(module, "__file__", ""))
    ]:
        del sys.modules[name]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 +", "broken.py:1: SyntaxError: invalid syntax"),
        (
            "Limit = 1\nx = Limt(2)",
            "broken.py:2: NameError: name 'Limt' is not defined. Did you mean: 'Limit'?",
        ),
        ("raise RuntimeError('no\\nlicence')", "broken.py:1: RuntimeError: no licence"),
        ("import not_there_at_all", "broken.py:1: ModuleNotFoundError"),
        ("raise SystemExit(0)", "broken.py:1: SystemExit"),
        ("class Odd(BaseException): pass\nraise Odd('two\\nlines')", "broken.py:2: Odd: two lines"),
    ],
)
def test_a_module_that_cannot_be_imported_is_named_in_one_line(tmp_path, loaded, text, said):
    (tmp_path / "broken.py").write_text(text)
    with pytest.raises(DominoError) as error:
        loaded(tmp_path)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_class_that_a_call_of_type_makes_is_of_the_module_that_registers_it(tmp_path, loaded):
    made = "register('made_' + 'thing')(type('Thing', (Family,), {'shape': len, 'frames': len}))\n"
    (tmp_path / "made_things.py").write_text(
        f"from pipeline.world.objects.contract import Family, register\n{made}"
    )
    loaded(tmp_path)
    assert FAMILIES.remove("made_thing").__module__ == "made_things"


def test_a_name_that_another_module_has_is_refused(tmp_path, loaded):
    (tmp_path / "numpy.py").write_text("")
    with pytest.raises(DominoError, match="another module is called 'numpy'"):
        loaded(tmp_path)


@pytest.mark.slow
def test_an_extension_goes_the_whole_way(tmp_path):
    plugins, out = tmp_path / "plugins", tmp_path / "set"
    shutil.copytree(EXAMPLE, plugins)
    recipe = tmp_path / "tap.yaml"
    recipe.write_text("tasks: own\nlevels: 1\nepisodes: 2\nsize: [64, 48]\n")
    choice = ("--manifest", recipe, "--out", out)
    assert "no task 'own'" in refused("build", *choice)
    assert "no directory" in refused("tasks", plugins=tmp_path / "nowhere")
    domino("check-task", "tap_eraser", "--levels", "0,1", plugins=plugins)
    domino("build", *choice, "--executor", "ray", "--workers", "2", plugins=plugins)
    assert pq.read_table(out / "attempts.parquet")["outcome"].to_pylist().count("accepted") == 2
    domino("verify", out, plugins=plugins)
    domino("export", out, "--format", "meetings-csv", plugins=plugins)
    assert len((out / "exports/meetings-csv/meetings.csv").read_text().splitlines()) == 3
    domino("verify", out, plugins=plugins)
    assert "2 slots are the same, 0 differ" in domino("diff", out, out, plugins=plugins)
    assert "0 files" in domino("gc", out, plugins=plugins)
    evaluated = (
        "--tasks",
        "tap_eraser",
        "--levels",
        "1",
        "--episodes",
        "1",
        "--out",
        tmp_path / "score",
    )
    assert "100" in domino("evaluate", "--policy", "replay", *evaluated, plugins=plugins)
    domino("evaluate", "--policy", "stay", *evaluated, plugins=plugins)
    assert "state bytes equal" in domino(
        "verify",
        out,
        "--episode",
        "tap_eraser/aloha-agilex/L1/clean/episode_0000000",
        plugins=plugins,
    )

    phrases = plugins / "phrases/eraser.txt"
    text = phrases.read_text()
    phrases.unlink()
    elsewhere = (*evaluated[:-1], tmp_path / "none")
    assert "write phrases/eraser.txt" in refused(
        "evaluate", "--policy", "stay", *elsewhere, plugins=plugins
    )
    phrases.write_text(text)

    # an edit of any plugin makes the episodes that use plugins stale, and none of another task
    mixed = tmp_path / "mixed"
    both = ("--tasks", "tap_eraser,click_bell", "--levels", "1", "--episodes", "1", "--out", mixed)
    domino("build", *both, "--executor", "inline", plugins=plugins)
    eraser = plugins / "eraser.py"
    eraser.write_text(eraser.read_text().replace("friction=0.6", "friction=0.5"))
    stale = "the physics of 1 slots again: changed motion, objects, task"
    assert stale in domino("status", mixed, plugins=plugins)
    eraser.write_text(eraser.read_text().replace("friction=0.5", "friction=0.6"))
    assert stale not in domino("status", mixed, plugins=plugins)
