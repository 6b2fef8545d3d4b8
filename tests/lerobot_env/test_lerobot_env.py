"""The environment type of LeRobot: scenes of the protocol, rewards that sum to MS, and lerobot-eval
from end to end."""

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.recipe.model import Cell
from pipeline.evaluate.scenes.benchmark import read_benchmark
from pipeline.evaluate.scenes.case import expert_actions, setup_of
from pipeline.evaluate.scenes.manifests import Manifests, inline
from pipeline.evaluate.scoring.metrics import score
from pipeline.tasks.contract import expand_tasks

ROOT = Path(__file__).parents[2]
PROJECT = ROOT / "lerobot_env_domino"
CELL = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
SMALL = setup_of({"cameras": ["head"], "size": [32, 24]})


@pytest.fixture(scope="module")
def lr():
    """What the tests name of LeRobot, which takes 8 s of CPU to import: in the process that runs
    them only."""
    pytest.importorskip("lerobot")
    from tests.lerobot_env import imported

    return imported


@pytest.fixture(scope="module")
def manifests(tmp_path_factory):
    return tmp_path_factory.mktemp("manifests")


@pytest.fixture
def task(manifests, lr):
    env = lr.DominoTask(lr.Scenes(CELL, manifests, setup=SMALL))
    yield env
    env.close()


def play(env, actions):
    """Rewards until the end, and the last info."""
    rewards = []
    for n in range(env._max_episode_steps):
        observation, reward, terminated, truncated, info = env.step(
            actions[min(n, len(actions) - 1)]
        )
        assert env.observation_space.contains(observation)
        rewards.append(reward)
        if terminated or truncated:
            return rewards, info
    raise AssertionError("the episode does not end in time")


def test_seeds_are_indices_of_the_admitted_scenes(task, manifests, lr):
    wanted = Manifests(manifests).admitted([CELL], 2, inline)[CELL]
    scenes = lr.Scenes(CELL, manifests)
    assert [scenes.case(seed) for seed in (1000, 1001)] == wanted
    assert wanted[0].spec.seed >= 100_000
    _, info = task.reset(seed=1001)
    assert task._env.case == wanted[1] and info["is_success"] is False
    assert "seed" not in info
    assert task.task_description == info["task_description"] != ""
    _, info = task.reset(seed=1000)
    task.reset()
    assert task._env.case == wanted[1]
    with pytest.raises(ValueError, match=r"set env\.first_seed"):
        scenes.case(999)


def test_a_benchmark_gives_its_frozen_scenes(lr):
    scenes = lr.Scenes(CELL, Path("unused"), setup=SMALL, benchmark="domino-v1")
    frozen = read_benchmark("domino-v1").cases([CELL], 50)[CELL]
    env = lr.DominoTask(scenes)
    env.reset(seed=1049)
    assert env._env.case == frozen[49]
    env.close()
    with pytest.raises(ValueError, match=r"has 50 scenes .* set eval\.n_episodes"):
        scenes.case(1050)


def test_a_success_is_worth_a_hundred_at_once(task, manifests, lr):
    task.reset(seed=1000)
    rewards, info = play(
        task, expert_actions(lr.Scenes(CELL, manifests).case(1000)).astype(np.float32)
    )
    assert info["is_success"] is True
    assert rewards[-1] == sum(rewards) == max(rewards) == 100


def test_rewards_sum_to_the_score_and_their_maximum_is_the_completion(task):
    observation, _ = task.reset(seed=1000)
    towards = observation["agent_pos"].copy()
    towards[[1, 8]] += 0.3
    rewards, info = play(task, towards[None])
    told = score(task._env.trial)
    assert told.penalties == ("out_of_bounds",) and told.route_completion > 0
    assert (
        sum(rewards)
        == pytest.approx(told.manipulation_score)
        == pytest.approx(told.route_completion / 2)
    )
    assert max(rewards) == pytest.approx(told.route_completion)
    assert info["is_success"] is False and info["manipulation_score"] == told.manipulation_score
    assert task.render().shape == (24, 32, 3)


def test_the_type_is_known_and_makes_nothing_before_it_is_used(lr):
    assert lr.EnvConfig.get_choice_class("domino") is lr.DominoEnvConfig
    envs = lr.DominoEnvConfig(task="all").create_envs(2)
    assert sorted(envs) == sorted(expand_tasks(["all"]))
    assert not any(group[0].made for group in envs.values())
    small = lr.DominoEnvConfig(task="click_bell, shake_bottle", setup=SMALL.given())
    assert list(small.create_envs(1)) == ["click_bell", "shake_bottle"]
    features = lr.env_to_policy_features(small)
    assert {key: feature.shape for key, feature in features.items()} == {
        "action": (14,),
        "observation.state": (14,),
        "observation.images.cam_high": (3, 24, 32),
    }


@pytest.mark.parametrize(
    "bad",
    [
        {"task": "fly"},
        {"setup": {"cameras": ["third_eye"]}},
        {"setup": {"cameras": []}},
        {"fps": 7},
        {"setup": {"rules": "house"}},
    ],
)
def test_an_option_that_does_not_exist_is_refused(bad, lr):
    with pytest.raises(ValueError, match=r"^env\."):
        lr.DominoEnvConfig(**bad)


def test_two_environments_end_one_after_the_other_and_wait(manifests, lr):
    config = lr.DominoEnvConfig(setup=SMALL.given(), manifests=str(manifests))
    vector = config.create_envs(2)["click_bell"][0]
    observation, _ = vector.reset(seed=[1000, 1001], options={lr.NEW_ROLLOUT_OPTION: True})
    assert lr.preprocess_observation(observation)["observation.images.cam_high"].shape == (
        2,
        3,
        24,
        32,
    )
    actions, ended, total = observation["agent_pos"], np.zeros(2, bool), np.zeros(2)
    for _ in range(vector.call("_max_episode_steps")[0]):
        _, reward, terminated, truncated, info = vector.step(actions)
        total += reward
        assert info["is_success"].tolist() == [False, False]
        ended |= terminated | truncated
        if ended.all():
            break
    assert ended.all()
    assert np.allclose(
        total, [score(env.unwrapped._env.trial).manipulation_score for env in vector._ensure().envs]
    )
    vector.close()


def test_the_file_for_the_hub_makes_environments(lr):
    module = lr._import_hub_module(str(PROJECT / "hub" / "env.py"), "user/repo")
    made = lr._normalize_hub_result(
        lr._call_make_env(module, n_envs=1, use_async_envs=False, cfg=None)
    )
    assert list(made) == ["click_bell"] and not made["click_bell"][0].made
    assert list(lr._call_make_env(module, 1, False, lr.HubEnvConfig(task="shake_bottle"))) == [
        "shake_bottle"
    ]


def test_lerobot_eval_runs_a_random_act_from_end_to_end(tmp_path, manifests, monkeypatch, lr):
    # what an installer writes: LeRobot finds environments by the names of distributions
    name = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["name"]
    site = tmp_path / "site" / f"{name}-0.1.0.dist-info"
    site.mkdir(parents=True)
    (site / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0\n")
    monkeypatch.syspath_prepend(site.parent)
    # as in a process that has not imported it
    monkeypatch.delitem(lr.EnvConfig._choice_registry, "domino")
    for module in [each for each in sys.modules if each.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    options = {
        "env.type": "domino",
        "env.task": "click_bell",
        "env.setup": json.dumps(SMALL.given()),
        "env.manifests": manifests,
        "policy.type": "act",
        "policy.device": "cpu",
        "policy.push_to_hub": "false",
        "policy.pretrained_backbone_weights": "null",
        "policy.dim_model": 32,
        "policy.n_heads": 2,
        "policy.dim_feedforward": 32,
        "policy.n_encoder_layers": 1,
        "policy.use_vae": "false",
        "eval.n_episodes": 2,
        "eval.batch_size": 1,
        "output_dir": out,
    }
    monkeypatch.setattr(
        sys, "argv", ["lerobot-eval", *(f"--{key}={value}" for key, value in options.items())]
    )
    lr.lerobot_eval.main()
    assert lr.EnvConfig.get_choice_class("domino") is not lr.DominoEnvConfig
    told = json.loads((out / "eval_info.json").read_text())
    assert told["per_group"]["click_bell"]["n_episodes"] == 2
    (metrics,) = [each["metrics"] for each in told["per_task"]]
    assert metrics["successes"] == [False, False]
    assert all(
        0 <= total <= best <= 100
        for total, best in zip(metrics["sum_rewards"], metrics["max_rewards"], strict=True)
    )
    assert len(list(out.rglob("*.mp4"))) == 2
