"""The sanity ladder as a whole: demonstrations, tables, and a small one end to end."""

import json
import sys
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Corrections
from pipeline.evaluate.scenes.manifests import inline
from pipeline.planning.planner import planner_for
from training.ladder.climb import Ladder, climb
from training.ladder.demonstrations import (
    ARRAYS,
    Demonstration,
    DemonstrationJob,
    fill,
    read_demonstrations,
)
from training.ladder.disturb import disturbances, disturbed
from training.ladder.image_rungs import ImageTraining, image_policy, lerobot_dataset
from training.ladder.lerobot_states import state_dataset
from training.ladder.network import Settings
from training.ladder.samples import LadderError, samples
from training.ladder.tables import RESULTS, read_results, summary, table, write_results


def test_a_datasets_episodes_are_those_made_without_images(built):
    recipe = Dataset(built).recipe()
    slot = next(iter(recipe.physical_slots()))
    found = list(read_demonstrations(built, recipe.cells()))
    assert len(found) == len(Dataset(built).accepted(recipe))
    made = fill(DemonstrationJob(recipe, slot))
    assert made is not None
    assert (made.cell, made.bodies, made.untouched) == (
        found[0].cell,
        found[0].bodies,
        found[0].untouched,
    )
    for name in ARRAYS:
        np.testing.assert_allclose(getattr(found[0], name), getattr(made, name), atol=1e-5)
    assert list(read_demonstrations(built, [])) == []


def test_objects_of_another_version_are_one_line(built, monkeypatch):
    monkeypatch.setattr("training.ladder.demonstrations.FAMILIES", {})
    with pytest.raises(
        EpisodeError,
        match=r"^[^\n]*: its objects are of another version \('bell'\): build the dataset again$",
    ):
        list(read_demonstrations(built, Dataset(built).recipe().cells()))


def test_named_points_move_with_their_body(built):
    episode = next(read_demonstrations(built, Dataset(built).recipe().cells()))
    # the bell's two points (button, top) stand above its origin, wherever it is; pressed, it tilts
    # a little
    at = episode.points - episode.poses[:, :1, :3]
    assert episode.bodies == ("bell",) and at.shape[1] == 2
    np.testing.assert_allclose(at[0, :, :2], 0, atol=1e-6)
    assert at[..., 2].min() > 0.02 and np.ptp(at[..., 2], 0).max() < 1e-6


def test_arms_off_their_path_are_shown_the_way_back(built):
    episode = next(read_demonstrations(built, Dataset(built).recipe().cells()))
    rng = np.random.default_rng(1)
    offsets = disturbances("aloha-agilex", len(episode.joints), episode.untouched, 0.1, rng)
    assert not offsets[episode.untouched :].any() and not offsets[:, [6, 13]].any()
    assert np.abs(offsets[: episode.untouched]).max() > 0.05
    off = disturbed(episode.state, "aloha-agilex", offsets)
    planner = planner_for("aloha-agilex")
    for k, (side, arm) in enumerate((("left", slice(0, 6)), ("right", slice(7, 13)))):
        # where the tool is, less what the measured pose differs from kinematics
        was = planner.fk(side, episode.joints[9, arm])[:3] - episode.tools[9, k, :3]
        np.testing.assert_allclose(
            planner.fk(side, off.joints[9, arm])[:3] - off.tools[9, k, :3], was, atol=1e-9
        )
    plain, more = (samples([episode], Settings(copies=n, chunk=3, spread=0.1))[1] for n in (0, 1))
    frames = len(plain)
    np.testing.assert_array_equal(more[:frames], plain)
    assert len(more) == 2 * frames
    # the actions are the same, so the differences from the joints are others: but for grippers, and
    # where something is held
    difference = more[frames:] - plain
    assert (
        difference[: episode.untouched, :, :6].any() and not difference[episode.untouched :].any()
    )
    assert not difference[..., [6, 13]].any()
    np.testing.assert_allclose(difference, difference[:, :1].repeat(3, 1), atol=1e-12)


def test_a_task_without_demonstrations_is_named(built, tmp_path):
    wanted = Ladder(
        Recipe(tasks=("stamp_seal",), levels=(1,), episodes=1),
        ("position",),
        ((8, 4),),
        1,
        1,
        data=built,
    )
    with pytest.raises(LadderError, match="stamp_seal"):
        climb(wanted, tmp_path, inline)


def results(task="t", solved=3, seeds=2):
    row = {
        "task": task,
        "embodiment": "aloha-agilex",
        "alpha": 0.1,
        "level": 1,
        "inputs": "position",
        "chunk": 8,
        "execute": 4,
    }
    return summary(
        [
            row
            | {
                "demonstrations": 9,
                "episodes": 10,
                "solved": solved + 2 * i,
                "solved_seeds": list(range(solved + 2 * i)),
            }
            for i in range(seeds)
        ]
    )


def test_seeds_are_summed_up_with_an_interval():
    (found,) = results()
    assert (found["success_rate"], found["episodes"], found["by_seed"]) == (40, 20, [30, 50])
    assert found["success_interval"][0] == pytest.approx(17.8, abs=0.1)
    # 3 scenes that both solve, 2 that one solves, 5 that none solves: 40 % of 11.4 independent
    # ones, Wilson by hand
    assert table([found]).splitlines()[-1] == "| t | position | 8 | 4 | 40 (18-67) |"


def test_results_of_other_tasks_stay_while_the_program_is_the_same(tmp_path):
    path = tmp_path / RESULTS
    write_results(path, results("a"), "one")
    write_results(path, results("b"), "one")
    write_results(path, results("a", 8), "one")
    rows, code = read_results(path)
    assert ([(row["task"], row["solved"]) for row in rows], code) == ([("b", 8), ("a", 18)], "one")
    write_results(path, results("a"), "two")
    assert [row["task"] for row in read_results(path)[0]] == ["a"]


TINY = """--policy.dim_model=32 --policy.dim_feedforward=32 --policy.n_vae_encoder_layers=1 --policy.n_encoder_layers=1
    --policy.vision_backbone=resnet18 --batch_size=2"""  # noqa: E501


@pytest.mark.slow
@pytest.mark.parametrize("rung", ["act", "act_velocity"])
def test_rungs_are_trained_by_lerobot_and_tried(built, tmp_path, rung):
    pytest.importorskip("lerobot")
    recipe = Recipe(tasks=("click_bell",), levels=(1,))
    made = {"data": built, "image_steps": 2, "code": "c"}
    wanted = Ladder(recipe, (rung,), ((4, 4),), 1, 1, train_options=tuple(TINY.split()), **made)
    (row,) = climb(wanted, tmp_path, inline)
    assert (row["inputs"], row["level"], row["episodes"], row["demonstrations"]) == (rung, 1, 1, 1)
    (found,) = map(json.loads, (tmp_path / "episodes.jsonl").read_text().splitlines())
    assert found["sees_truth"] == (rung != "act") and found["asked"] == -(-found["periods"] // 4)
    (policy,) = (tmp_path / "networks" / "click_bell").iterdir()
    assert json.loads((policy / "config.json").read_text())["dim_model"] == 32
    assert climb(wanted, tmp_path, inline) == [row]


@pytest.mark.slow
def test_states_for_lerobot_end_with_the_success(built, tmp_path):
    pytest.importorskip("lerobot")
    (shown,) = read_demonstrations(built, Recipe(tasks=("click_bell",), levels=(1,)).cells())
    out = state_dataset([shown], Settings(inputs="velocity", copies=0), tmp_path)
    table = pq.read_table(next((out / "data").rglob("*.parquet")))
    assert len(table) == shown.solved < len(shown.joints)
    seen = np.array(table["observation.environment_state"].to_pylist())
    np.testing.assert_allclose(seen[:, -3:], shown.velocity[: shown.solved], atol=1e-6)
    assert state_dataset([shown], Settings(inputs="velocity", copies=0), tmp_path) == out


@pytest.mark.slow
def test_the_words_for_diffusion_make_its_configuration():
    configuration = pytest.importorskip("lerobot.policies.diffusion.configuration_diffusion")
    words = ImageTraining("diffusion", 8, 4, 3, 10, ("--policy.device=cuda",)).command(
        Path("data"), Path("out")
    )
    assert "--seed=3" in words and words[-1] == "--policy.device=cuda"
    given = dict(
        word.removeprefix("--policy.").split("=") for word in words if word.startswith("--policy.")
    )
    assert (
        given.pop("type") == "diffusion"
        and given.pop("device") == "cuda"
        and given.pop("push_to_hub") == "false"
    )
    known = {field.name for field in fields(configuration.DiffusionConfig)}
    assert {"horizon", "n_action_steps", *given} <= known
    config = configuration.DiffusionConfig(
        horizon=int(given["horizon"]),
        n_action_steps=int(given["n_action_steps"]),
        down_dims=tuple(json.loads(given["down_dims"])),
    )
    assert config.n_obs_steps == 2


@dataclass(frozen=True)
class StandIn(ImageTraining):
    """A training that runs a line of Python with the output directory in place of lerobot-train."""

    code: str = ""

    def command(self, dataset, out):
        return [sys.executable, "-c", self.code, str(out)]


def test_a_trained_policy_is_kept_and_a_failed_training_says_why(tmp_path):
    saves = (
        "import os, sys; os.makedirs(p := sys.argv[1] + '/checkpoints/2/pretrained_model'); open(p"
        " + '/config.json', 'w');"
    )
    saves += "os.symlink('2', sys.argv[1] + '/checkpoints/last')"
    training = StandIn("act", 4, 2, 0, 2, code=saves)
    path = image_policy(training, tmp_path / "bells_1", tmp_path / "out")
    assert [file.relative_to(path).as_posix() for file in path.rglob("*")] == ["config.json"]
    before = path.stat().st_mtime_ns
    assert (
        image_policy(training, tmp_path / "bells_1", tmp_path / "out").stat().st_mtime_ns == before
    )
    failing = StandIn("act", 4, 2, 0, 2, code="raise SystemExit('said\\nno such option')")
    with pytest.raises(LadderError, match=r"^lerobot-train failed: no such option$"):
        image_policy(failing, tmp_path / "bells_1", tmp_path / "out")
    assert image_policy(training, tmp_path / "bells_2", tmp_path / "out") != path


def test_a_dataset_is_exported_for_lerobot_once(built, tmp_path):
    cells = Recipe(tasks=("click_bell",), levels=(1, 3)).cells()
    out, count = lerobot_dataset(built, cells, tmp_path)
    assert count == 2 and (out / "meta" / "info.json").is_file()
    before = (out / "meta" / "info.json").stat().st_mtime_ns
    assert (
        lerobot_dataset(built, cells, tmp_path) == (out, 2)
        and (out / "meta" / "info.json").stat().st_mtime_ns == before
    )
    assert lerobot_dataset(built, cells[:1], tmp_path)[0] != out
    with pytest.raises(LadderError, match="stamp_seal"):
        lerobot_dataset(built, Recipe(tasks=("stamp_seal",)).cells(), tmp_path)


def test_what_a_policy_did_before_a_correction_is_not_imitated(built, tmp_path, monkeypatch):
    ladder = Ladder(
        Recipe(tasks=("click_bell",)),
        ("velocity",),
        ((8, 4),),
        1,
        1,
        Settings(),
        built,
        "",
        corrections=(built,),
    )
    with pytest.raises(LadderError, match="holds no corrections"):
        climb(ladder, tmp_path, inline)
    corrected = Recipe(
        tasks=("click_bell",), corrections=Corrections(policy="static", label="static")
    )
    monkeypatch.setattr(Dataset, "recipe", lambda self: corrected.override({"fps": 30}))
    with pytest.raises(
        LadderError, match=r"was made with strict-30hz, the demonstrations with strict$"
    ):
        climb(replace(ladder, data=None), tmp_path, inline)
    monkeypatch.setattr(Dataset, "recipe", lambda self: corrected)
    with pytest.raises(
        LadderError, match="holds no episode of press_stapler with this robot, levels and alpha"
    ):
        climb(replace(ladder, data=None, recipe=Recipe(tasks=("press_stapler",))), tmp_path, inline)
    with pytest.raises(
        LadderError, match="holds corrections, whose first frames show a policy's actions"
    ):
        lerobot_dataset(built, corrected.cells(), tmp_path)
    assert not list(tmp_path.glob("**/meta"))


def test_a_small_ladder_end_to_end(tmp_path):
    recipe = Recipe(tasks=("click_bell",), levels=(1,), episodes=2)
    wanted = Ladder(
        recipe, ("position", "two_frames"), ((8, 4),), 1, 1, Settings(steps=300, width=32), code="c"
    )
    rows = climb(wanted, tmp_path, inline)
    assert [(r["level"], r["inputs"], r["episodes"], r["demonstrations"]) for r in rows] == [
        (1, kind, 1, 2) for kind in ("position", "two_frames")
    ]
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert all(json.loads(line)["sees_truth"] for line in lines)
    before, (demonstration,) = (
        files(tmp_path),
        (tmp_path / "demonstrations").glob("**/episode_0000000.npz"),
    )
    assert len(before) == 4

    # a round more: nothing is made again, and the network learns what the expert did after it on a
    # scene that is new
    twice = replace(wanted, inputs=("position",), rounds=1)
    first, second = climb(twice, tmp_path, inline)
    assert (first, second["round"], second["demonstrations"]) == (rows[0], 1, 4)
    assert files(tmp_path).items() >= before.items() and len(files(tmp_path)) == 7
    (correction,) = (tmp_path / "demonstrations").glob("**/*-seed1/**/episode_0000000.npz")
    made, corrected = Demonstration.read(demonstration), Demonstration.read(correction)
    assert (
        made.corrected == 0 < corrected.corrected
        and np.abs(made.poses[0] - corrected.poses[0]).max() > 0.01
    )
    after, tried = files(tmp_path), (tmp_path / "episodes.jsonl").read_bytes()
    assert climb(twice, tmp_path, inline) == [first, second] and files(tmp_path) == after
    assert (tmp_path / "episodes.jsonl").read_bytes() == tried and tried.count(b"\n") == 3
    found, _ = read_results(tmp_path / RESULTS)
    assert sorted((row["inputs"], row["round"]) for row in found) == [
        ("position", 0),
        ("position", 1),
        ("two_frames", 0),
    ]
    assert table(found).splitlines()[0] == "| task | input | chunk | executed | round | level 1 |"


def files(root):
    """When each archive below a directory was written."""
    return {path: path.stat().st_mtime_ns for path in root.rglob("*.npz")}
