"""The documents say what is true: every key of an episode is described, every command line they
show parses."""

import re
import shlex
import subprocess
from pathlib import Path

import click
import h5py
import pytest
import typer
import yaml

from pipeline.cli import app, split_plugins
from tests.synthetic import make_episode

ROOT = Path(__file__).parent.parent
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").rglob("*.md")),
)
CLI = typer.main.get_command(app)
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def command_lines(page: Path) -> list[str]:
    """Lines of the page's shell blocks, continuations joined, comments and prompts dropped."""
    blocks = re.findall(
        r"^```(?:sh|bash|console)\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL
    )
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [
        line.removeprefix("$ ").strip()
        for line in lines
        if line.strip() and not line.lstrip().startswith("#")
    ]


SHOWN = [(page.name, line) for page in PAGES for line in command_lines(page)]


@pytest.mark.parametrize(("page", "line"), SHOWN)
def test_every_command_shown_parses(page, line):
    words = shlex.split(line, comments=True)
    name = Path(words[0]).name
    if name == "ray":
        assert words[1] in ("start", "stop")
    elif name == "source":
        assert words[1:] == [".venv/bin/activate"]
    elif name == "make":
        assert {w for w in words[1:] if "=" not in w} <= TARGETS, f"{page}: {line}"
    # the page's own format: tests/test_docs_followed.py runs it
    elif name == "domino-data" and "npz" not in words:
        assert isinstance(CLI, click.Group | typer.core.TyperGroup)
        verb, *rest = split_plugins(words[1:])[0]
        command = CLI.commands[verb]
        while (
            isinstance(command, click.Group | typer.core.TyperGroup)
            and rest
            and rest[0] in command.commands
        ):
            verb, *rest = rest
            command = command.commands[verb]
        with command.make_context(verb, rest) as context:
            assert context.params


def block(page: str, language: str) -> str:
    """The only block of a language on a page of docs/."""
    (found,) = re.findall(
        rf"^```{language}\n(.*?)^```", (ROOT / "docs" / page).read_text(), re.MULTILINE | re.DOTALL
    )
    return found


def parsed(line: str) -> dict[str, object]:
    """The options of a `domino-data` command line."""
    assert isinstance(CLI, click.Group | typer.core.TyperGroup)
    verb, *rest = shlex.split(line)[1:]
    with CLI.commands[verb].make_context(verb, rest) as context:
        return context.params


def test_the_slurm_script_is_one_and_its_command_parses():
    script = block("cluster.md", "slurm")
    assert script.startswith("#!/bin/bash\n#SBATCH ")
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    line = script.replace("\\\n", " ")
    line = line[line.index("domino-data build") :].replace(
        "$((SLURM_JOB_NUM_NODES * SLURM_CPUS_PER_TASK))", "128"
    )
    values = parsed(line)
    assert (
        values["workers"] == 128 and values["address"] and (ROOT / str(values["manifest"])).exists()
    )


def test_the_kuberay_job_is_one_and_its_command_parses():
    job = yaml.safe_load(block("cluster.md", "yaml"))
    assert (job["apiVersion"], job["kind"]) == ("ray.io/v1", "RayJob")
    values = parsed(job["spec"]["entrypoint"])
    assert values["address"] == "$RAY_ADDRESS" and (ROOT / str(values["manifest"])).exists()
    cluster = job["spec"]["rayClusterSpec"]
    groups = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    cores = sum(
        group.get("replicas", 1) * int(group["rayStartParams"]["num-cpus"]) for group in groups
    )
    assert values["workers"] == cores
    for group in groups:
        (container,) = group["template"]["spec"]["containers"]
        assert (
            container["image"]
            and {"name": "data", "mountPath": "/data"} in container["volumeMounts"]
        )
        assert str(values["out"]).startswith("/data/")


def test_the_quickstart_shows_the_main_verbs():
    verbs = {
        shlex.split(line)[1]
        for page, line in SHOWN
        if page == "quickstart.md" and "domino-data" in line
    }
    assert verbs >= {"tasks", "plan", "build", "status", "verify", "export"}


def test_every_link_between_the_pages_leads_somewhere():
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text()):
            assert link.startswith("http") or (page.parent / link).exists(), f"{page.name}: {link}"


def test_every_key_and_attribute_of_an_episode_is_described(tmp_path):
    path = make_episode(tmp_path / "e.hdf5", frames=3, depth=True, segmentation=True)
    text = (ROOT / "docs" / "formats.md").read_text()
    described = set(re.findall(r"`([^`\n]+)`", text))
    found: list[str] = []
    with h5py.File(path) as f:
        found += [str(a) for a in f.attrs]
        for column in f["state/contacts"].dtype.names:
            found.append(column)

        def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
            found.extend(item.attrs)
            if isinstance(item, h5py.Dataset):
                general = re.sub(r"^observation/\w+/", "observation/<camera>/", name)
                general = re.sub(r"^objects/\w+/", "objects/<name>/", general)
                found.append(general.removeprefix("interception/"))

        f.visititems(visit)
    assert len(found) > 40
    assert sorted(set(found) - described) == []
