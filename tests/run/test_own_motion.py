"""A motion from outside the package goes the whole way: build, verify, export, card, report."""

import json
from functools import partial

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import RecipeError
from pipeline.motion.models import MODELS, motion_from_json, register
from pipeline.report.viewer import write_viewer
from pipeline.run.checks.regenerate import regenerate
from pipeline.run.export import Request, export
from pipeline.run.names import recipe_from
from pipeline.run.state import status
from tests.motion.sway import SwayModel


def domino(*words: object) -> int:
    return CliRunner().invoke(app, [str(word) for word in words]).exit_code


@pytest.fixture
def sway():
    register(SwayModel())
    yield
    MODELS.remove("sway")


@pytest.mark.usefixtures("without_report")
def test_a_dataset_of_an_own_motion(sway, tmp_path):
    recipe, out = tmp_path / "sway.yaml", tmp_path / "set"
    recipe.write_text("tasks: click_bell\nmotion: sway\nlevels: 4\nepisodes: 1\nsize: [64, 48]\n")
    assert domino("build", "--manifest", recipe, "--out", out, "--executor", "inline") == 0
    assert domino("verify", out) == 0
    dataset = Dataset(out)
    [path] = dataset.accepted(dataset.recipe())
    with open_episode(path) as episode:
        motion, log = motion_from_json(episode.read().motion), episode.read().log
    assert motion.model == "sway"
    until = log.times < log.time_of("release")
    np.testing.assert_allclose(log.pose("bell")[until], motion.pose(log.times[until]), atol=1e-5)
    for form in ("lerobot", "parquet", "puma-gt"):
        assert domino("export", out, "--format", form) == 0
    assert (
        "sway level 4 (swaying from side to side)"
        in (out / "exports/parquet/README.md").read_text()
    )
    assert json.loads((out / "provenance.json").read_text())
    own = MODELS.remove("sway")
    assert domino("verify", out) == 0
    for of in (
        status,
        partial(regenerate, episode=next(dataset.recipe().slots()).path),
        partial(export, request=Request("parquet")),
        lambda held: write_viewer(held.root, [path], tmp_path / "pages", 1),
    ):
        with pytest.raises(
            DominoError, match="needs the motion 'sway', which is not installed: give --plugins"
        ):
            of(dataset)
    register(own)


def test_levels_are_those_of_the_model(sway):
    with pytest.raises(RecipeError, match=r"levels: 1 is unknown; sway has 0, 4"):
        recipe_from({"tasks": "click_bell", "motion": "sway", "levels": [1]})
    with pytest.raises(RecipeError, match=r"no motion 'swing'; choose from .*planar, .*sway"):
        recipe_from({"tasks": "click_bell", "motion": "swing"})
