"""Experiments of the paper: everything that their commands name exists, and two run at tiny
size."""

from pathlib import Path

import pytest

from training.puma.cli import app
from training.puma.errors import TrainError
from training.puma.experiments.paper import FULL, STUDIES, TINY, study
from training.puma.experiments.table import EXPERIMENTS
from training.puma.reading import names, read_config

MANIFESTS = Path(__file__).parents[4] / "manifests" / "paper"


@pytest.mark.parametrize("name", STUDIES)
def test_recipe_configurations_and_table_exist(name: str):
    found, known = study(name), names()
    assert (MANIFESTS / f"{found.manifest}.yaml").is_file() and found.table in EXPERIMENTS
    labels = [network.label for network in found.networks]
    assert len(set(labels)) == len(labels)
    for number, network in enumerate(found.networks):
        assert {size.base + network.config for size in (FULL, TINY)} <= set(known)
        assert not network.start or network.start in labels[:number]


def test_every_closed_loop_experiment_of_the_paper_has_commands():
    assert {found.table for found in STUDIES.values()} == set(EXPERIMENTS)
    with pytest.raises(TrainError, match="ablation"):
        study("none")


def test_configurations_are_those_of_the_papers_tables():
    for base in ("puma-4b", "puma-tiny"):
        frames = read_config(f"{base}-raw-frames").model
        assert (frames.history, frames.world_queries, frames.world) == (
            "frames",
            2,
            read_config(base).model.world,
        )
        context = read_config(f"{base}-contextvla").model
        assert (context.history, context.world) == ("frames", "none")
        oracle = read_config(f"{base}-oracle").model
        assert (oracle.history, oracle.world, oracle.oracle) == ("none", "none", True)
    assert read_config("puma-4b-co-training").model.world_queries == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mixture", "cross-level"])
def test_an_experiment_runs_at_tiny_size(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    app(["paper", name, "--out", str(tmp_path), "--tiny"], standalone_mode=False)
    printed = capsys.readouterr().out
    assert printed.count("differs from the paper") == len(study(name).networks)
    for network in study(name).networks:
        assert (tmp_path / network.label / "checkpoints" / "step_00000001").is_dir()
