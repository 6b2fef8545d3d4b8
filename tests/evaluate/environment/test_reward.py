"""The dense reward: what it adds up to for policies that work and for policies that cheat, and how
far an episode is."""

import gymnasium
import numpy as np
import pytest

import pipeline.evaluate.scenes.case as attempts
from pipeline.evaluate import DominoEnv, env_id
from pipeline.evaluate.environment.observation import Shaped
from pipeline.evaluate.scenes.case import expert_actions
from pipeline.evaluate.scenes.manifests import OtherCase
from tests.evaluate.environment.test_env import case_of

DISCOUNT = 0.97


def make(task, **options):
    return DominoEnv(task, observations="state", reward="dense", discount=DISCOUNT, **options)


def play(env, case, actions):
    """Discounted sum of an episode's rewards, its steps, the sums of its progress, and the
    observations."""
    first, _ = env.reset(options={"case": case})
    total, seen = 0.0, [first]
    for n in range(1000):
        observation, reward, terminated, truncated, info = env.step(
            actions[min(n, len(actions) - 1)]
        )
        total, seen = total + DISCOUNT**n * reward, [*seen, observation]
        if terminated or truncated:
            return total, n, info, np.array(seen)
    raise AssertionError("the episode does not end")


def column(env, seen, name):
    return seen[:, env.state_names.index(name)]


@pytest.fixture(scope="module")
def bell():
    return case_of("click_bell", 0)


def test_only_a_success_adds_to_what_an_episode_is_worth(bell):
    env = make("click_bell", level=0)
    actions = expert_actions(bell)
    start, _ = env.reset(options={"case": bell})
    names = env.state_names
    potential = np.mean(
        [start[names.index(name)] for name in ("approach", "hold", "lift", "place")]
    )
    held = column(env, play(env, bell, actions)[3], "hold")
    near = actions[: int(np.argmax(held > 0)) - 8]
    cheats = {
        "stays at home": actions[:1],
        "hovers over the target": near,
        "goes there and back": np.concatenate([near, near[::-1], near, near[::-1], near]),
    }
    solved, steps, info, seen = play(env, bell, actions)
    assert info["is_success"]
    assert solved == pytest.approx(DISCOUNT**steps - potential, abs=1e-5)
    closest = 0.0
    for cheat, rows in cheats.items():
        worth, _, info, tried = play(env, bell, rows)
        assert info["ending"] == "time_limit", cheat
        assert worth == pytest.approx(-potential, abs=1e-5), cheat
        assert worth < solved, cheat
        closest = max(closest, column(env, tried, "approach").max())
    assert closest > 0.6, "a policy is to hover near the target"
    assert column(env, seen, "hold")[-1] == column(env, seen, "place")[-1] == 1


def test_any_course_of_the_potential_adds_up_to_its_start():
    rng = np.random.default_rng(0)
    for ending, base in (("success", 1.0), ("time_limit", 0.0), ("out_of_view", 0.0)):
        potentials = rng.random(50)
        shaped = Shaped(DISCOUNT, potentials[0])
        rewards = [shaped.reward(p, "" if n < 48 else ending) for n, p in enumerate(potentials[1:])]
        assert np.sum(rewards * DISCOUNT ** np.arange(49)) == pytest.approx(
            base * DISCOUNT**48 - potentials[0]
        )


def test_what_is_lifted_and_brought_counts():
    case = case_of("place_container_plate", 1)
    env = make("place_container_plate")
    _, _, info, seen = play(env, case, expert_actions(case))
    assert info["is_success"]
    tools = [
        np.stack([column(env, seen, f"{side}_tool_{axis}") for axis in "xyz"], -1)
        for side in ("left", "right")
    ]
    container, plate = (
        np.stack([column(env, seen, f"{name}_{axis}") for axis in "xyz"], -1)
        for name in ("container", "plate")
    )
    side = next(iter(env.trial.scene.arms.values())) == "right"
    held = column(env, seen, "hold") > 0
    nearness = 1 - np.tanh(3 * np.linalg.norm(tools[side] - container, axis=-1))
    np.testing.assert_allclose(column(env, seen, "approach")[~held], nearness[~held], atol=1e-5)
    rise = np.maximum.accumulate(container[:, 2] - container[0, 2]) / 0.05
    np.testing.assert_allclose(column(env, seen, "lift"), np.clip(rise, 0, 1), atol=1e-4)
    assert 0.2 < held.mean() < 0.9
    beside = 1 - np.tanh(3 * np.linalg.norm((container - plate)[-1, :2]))
    assert column(env, seen, "place")[-1] == pytest.approx((1 + beside) / 2, abs=1e-5)
    assert column(env, seen, "place")[0] == 0
    moved = np.diff(plate[:10], axis=0).mean(0) * 15
    velocity = [column(env, seen, f"plate_v{axis}")[:9].mean() for axis in "xyz"]
    np.testing.assert_allclose(velocity, moved, atol=1e-4)


def test_the_expert_runs_once_for_the_scenes_of_an_environment(monkeypatch):
    env = make("click_bell", level=0, scenes=2)
    first, _ = env.reset(seed=5)
    found = {env.reset()[0].tobytes() for _ in range(12)}
    assert len(found) == 2
    monkeypatch.setattr(attempts, "attempt", None)
    again, _ = make("click_bell", level=0, scenes=2).reset(seed=5)
    assert (first == again).all()


def test_environments_step_together():
    vector = gymnasium.make_vec(
        env_id("click_bell"),
        num_envs=2,
        vectorization_mode="sync",
        level=0,
        observations="state",
        reward="dense",
        scenes=1,
    )
    observations, _ = vector.reset(seed=1)
    assert vector.observation_space.contains(observations)
    observations, rewards, *_ = vector.step(vector.action_space.sample())
    assert observations.shape[0] == len(rewards) == 2
    vector.close()


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("click_alarmclock", {"level": 0}), "differ in task"),
        (("click_bell", {"level": 1}), "level"),
        (("click_bell", {"level": 0, "alpha": 0.2}), "alpha"),
        (("click_bell", {"level": 0, "setup": {"contact": "hold"}}), "setup"),
    ],
)
def test_a_case_of_another_cell_is_refused(bell, options, named):
    task, given = options
    with pytest.raises(OtherCase, match=named):
        make(task, **given).reset(options={"case": bell})
    with pytest.raises(OtherCase, match="int is no case"):
        make(task, **given).reset(options={"case": 3})


@pytest.mark.parametrize(
    "bad",
    [
        {"reward": "much"},
        {"observations": "all"},
        {"discount": 0.0},
        {"scenes": -1},
        {"scenes": "a"},
    ],
)
def test_an_option_of_learning_that_does_not_exist_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        gymnasium.make(env_id("click_bell"), **({"reward": "dense"} | bad))
