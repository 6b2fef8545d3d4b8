"""The files that developers work by agree with each other: Makefile, hooks and project file."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parent.parent


def test_make_help_lists_every_target():
    phony = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony
    shown = subprocess.run(
        ["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert set(re.findall(r"^  make ([\w-]+) +\S", shown, re.MULTILINE)) == set(phony[1].split())


@pytest.mark.parametrize(
    ("name", "source", "wanted"),
    [
        (
            "debian.sources",
            "Types: deb\nURIs: http://packages.test/debian\nSigned-By: /keys/archive.gpg\n",
            (
                "deb [signed-by=/keys/archive.gpg] http://packages.test/debian/ bookworm-backports"
                " main"
            ),
        ),
        (
            "old.list",
            "deb [arch=amd64 signed-by=/keys/old.gpg] http://packages.test/debian bookworm main\n",
            "deb [signed-by=/keys/old.gpg] http://packages.test/debian/ bookworm-backports main",
        ),
        (
            "plain.list",
            "deb http://packages.test/debian bookworm main\n",
            "deb http://packages.test/debian/ bookworm-backports main",
        ),
    ],
)
def test_the_set_up_takes_backports_from_the_machines_own_sources(tmp_path, name, source, wanted):
    script = (ROOT / "scripts" / "setup.sh").read_text()
    function = re.search(r"^backports_line\(\) \{.*?^\}$", script, re.MULTILINE | re.DOTALL)
    assert function
    (tmp_path / name).write_text(source)
    rows = (
        ("bookworm-security main", "security", 2),
        ("bookworm contrib", "other", 1),
        ("bookworm main", "debian", 1),
    )
    targets = "".join(
        f"{of} http://packages.test/{place}/ {tmp_path}/{name}:{line}\n" for of, place, line in rows
    )
    (tmp_path / "targets").write_text(targets)
    (tmp_path / "apt-get").write_text(f"#!/bin/sh\ncat {tmp_path}/targets\n")
    (tmp_path / "apt-get").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def line(release):
        command = ["bash", "-euo", "pipefail", "-c", f"{function[0]}\nbackports_line {release}"]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    assert line("bookworm").stdout.strip() == wanted
    none = line("trixie")
    assert (none.returncode, none.stdout) == (1, "")


def test_no_server_of_packages_is_written_in_the_repository():
    files = [
        ROOT / "Makefile",
        *(ROOT / "scripts").glob("**/*.??"),
        *(ROOT / ".ci").iterdir(),
        ROOT / "pyproject.toml",
    ]
    found = {host for file in files for host in re.findall(r"https?://([\w.-]+)", file.read_text())}
    # uv's own site: its installer, and a page to read
    assert found <= {"astral.sh", "docs.astral.sh"}


def test_the_hooks_are_the_checks_of_make_lint():
    lint = re.search(r"^lint:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert lint
    wanted = {tuple(line.split("/", 1)[1].split()[:2]) for line in lint[1].splitlines()}
    repos = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert [repo["repo"] for repo in repos] == ["local"]
    hooks = {
        tuple(hook["entry"].removeprefix(".venv/bin/").split()[:2]) for hook in repos[0]["hooks"]
    }
    assert hooks == wanted


def test_the_architecture_lists_the_rooms_in_the_order_of_the_import_contract():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ][0]["layers"]
    page = (ROOT / "docs/architecture.md").read_text().split("## The rooms", 1)[1].split("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*`) \|", page, re.MULTILINE)
    listed = [room for row in rows for room in re.findall(r"`(\w+)`", row)]
    floor = {room.strip(): n for n, layer in enumerate(layers) for room in layer.split("|")}
    packages = [room for room in floor if (ROOT / "pipeline" / room).is_dir()]
    assert sorted(listed) == sorted(packages)
    assert [floor[room] for room in listed] == sorted(floor[room] for room in listed)


def test_every_room_is_in_the_import_contract():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ][0]["layers"]
    there = {
        p.name.removesuffix(".py")
        for p in (ROOT / "pipeline").iterdir()
        if p.suffix == ".py" or (p / "__init__.py").exists()
    }
    assert {room.strip() for layer in layers for room in layer.split("|")} == there - {"__init__"}


def test_the_newest_version_of_the_changelog_is_the_projects():
    versions = re.findall(
        r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$",
        (ROOT / "CHANGELOG.md").read_text(),
        re.MULTILINE,
    )
    assert versions[0] == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_the_tools_of_the_hooks_are_locked():
    group = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]["dev"]
    assert {"ruff", "pyright", "import-linter"} <= {
        re.split(r"[\[>=<]", entry)[0] for entry in group
    }


@pytest.mark.parametrize(
    ("stamp", "profile", "made"),
    [("", "core", "core"), ("core", "all", "all"), ("all", "core", None), ("core", "core", None)],
)
def test_the_core_never_shrinks_an_environment_that_holds_all(tmp_path, stamp, profile, made):
    """`made` is the profile that the set-up would install, None where it finds nothing to do."""
    script = (ROOT / "scripts" / "setup.sh").read_text()
    head, _, _ = script.partition("as_root() {")
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "setup.sh").write_text(f'{head}ready && exit 0; echo "$PROFILE"\n')
    (tmp_path / "stamp.sh").write_text(f"{head}key > $STAMP\n".replace("/..", ""))
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "python").symlink_to("/bin/true")
    for name in ("uv.lock", "pyproject.toml"):
        (tmp_path / name).touch()

    def shell(name: str, *words: str) -> str:
        return subprocess.run(
            ["bash", name, *words], cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.strip()

    if stamp:
        shell("stamp.sh", stamp)
    assert shell("scripts/setup.sh", profile) == (made or "")
