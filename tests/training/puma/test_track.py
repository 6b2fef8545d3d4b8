"""Tracking by itself: pixels and places, sightings that are wrong, and a run that acts on what it
found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.data.cameras import look, project
from tests.training.puma.test_train import seen, start
from tests.training.puma.tiny import config_of
from training.puma.config import Config, parse_config
from training.puma.corpus.mixture import open_corpus
from training.puma.errors import TrainError
from training.puma.finding.tools import Disturbance, tools_of, touch_points
from training.puma.finding.tracking import choice_of, since_touch
from training.puma.loop.loader import targets_of
from training.puma.measure.checks import replay_check
from training.puma.model.puma import Outputs, Sizes, build_model
from training.puma.policy import PumaPolicy
from training.puma.preprocess import Preprocessing
from training.puma.track import CHOICES, TargetView, Track, track_numbers
from training.puma.train import train

SIGHT = TargetView((240, 320), 37.0, tuple(look((0.0, -0.5, 1.4), (0.0, 0.6, -0.7))), 0.76, 0.03)
EXACT = np.full(3, 0.3)


def pixels(x: float, y: float) -> np.ndarray:
    """Where the points of a target at x, y that lies along the world's axes are seen."""
    points = np.array([x, y, SIGHT.height]) + SIGHT.reach * np.array(
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    )
    return project(SIGHT.camera, np.array(SIGHT.pose), points)[0]


def test_points_are_projected_and_taken_back_to_the_plane():
    poses = np.array(
        [
            [0.1, -0.05, SIGHT.height, 1, 0, 0, 0],
            [-0.2, 0.1, SIGHT.height, np.sqrt(0.5), 0, 0, np.sqrt(0.5)],
        ]
    )
    found = SIGHT.pixels(poses)
    assert found[0] == pytest.approx(pixels(0.1, -0.05))
    assert SIGHT.places(found[:, 0]) == pytest.approx(poses[:, :2])
    # turned by a quarter about z, the point on the x axis lies along y
    assert SIGHT.places(found[1, 1]) == pytest.approx([-0.2, 0.1 + SIGHT.reach])
    assert np.isfinite(SIGHT.places([160.0, -1000.0])).all()
    beside = SIGHT.pixels(poses, [[[0.1, 0, 0]], [[0.1, 0, 0]]])
    assert beside[:, :3] == pytest.approx(found)
    assert SIGHT.places(beside[:, 3]) == pytest.approx(np.array([[0.2, -0.05], [-0.2, 0.2]]))


def test_touch_points_are_the_tools_at_the_first_touch_as_the_target_sees_them(
    dataset: Path, cache: Path
):
    found = open_corpus(small(dataset, cache)).train[0].cache
    joints = np.linspace(-0.3, 0.3, 8)[:, None] * np.ones(14)
    places = tools_of(found.rows[0].embodiment, joints)
    # two episodes of four frames, the first touched at its third frame, the second never; turned by
    # half a turn about z
    target = np.array([0.1, 0.2, 0.8, 0, 0, 0, 1])
    arrays = {
        "state": joints,
        "free": np.array([True, True, False, False, *[True] * 4]),
        "target": np.tile(target, (8, 1)),
    }
    rows = [replace(found.rows[0], length=4)] * 2
    points = touch_points(replace(found, rows=rows, arrays=arrays))
    for frames, at in ((slice(0, 4), 2), (slice(4, 8), 7)):
        expected = (places[at] - target[:3]) * [-1, -1, 1]
        assert points[frames] == pytest.approx(np.tile(expected, (4, 1, 1)), abs=1e-6)


def test_a_track_has_the_velocity_and_keeps_it_while_sightings_are_wrong():
    track = Track(SIGHT)
    for i in range(30):
        hidden = i in (17, 18, 19)
        seen = pixels(0.0, 0.2) if hidden else pixels(-0.1 + 0.08 * i / 15, 0.05)
        track.see(i / 15, seen, 60 * EXACT if hidden else EXACT)
        if i >= 12:
            assert track.numbers[:2] == pytest.approx([-0.1 + 0.08 * i / 15, 0.05], abs=4e-3)
            assert track.numbers[2:4] == pytest.approx([0.08, 0.0], abs=2e-2)
    assert track.numbers[4:6] == pytest.approx([SIGHT.reach, 0.0], abs=2e-3)


def test_a_track_without_memory_is_the_last_sighting():
    track, fresh = Track(SIGHT, memory=False), Track(SIGHT)
    for i in range(6):
        track.see(i / 15, pixels(-0.1 + 0.02 * i, 0.05), EXACT)
    fresh.see(5 / 15, pixels(0.0, 0.05), EXACT)
    assert track.numbers == pytest.approx(fresh.numbers, abs=1e-6)
    assert track.numbers[:4] == pytest.approx([0.0, 0.05, 0, 0], abs=1e-6) and track.speed == 0


def test_one_sighting_far_away_moves_a_track_little_even_if_the_finder_does_not_doubt():
    track = Track(SIGHT)
    for i in range(20):
        track.see(i / 15, pixels(0.1, 0.05), EXACT)
    track.see(20 / 15, pixels(-0.2, 0.05), EXACT)
    assert np.abs(track.numbers[:2] - [0.1, 0.05]).max() < 0.02


def small(dataset: Path, cache: Path, **track: int) -> Config:
    """`puma-small` with a few hundred weights, on images of 240 x 320."""
    values = config_of(dataset, cache).model_dump(mode="json")
    values["model"] |= {
        "backbone": {"kind": "perceptron", "weights": "random", "width": 16, "layers": 1},
        "world": "none",
    }
    values["model"] |= {
        "history": "none",
        "offsets": True,
        "arms": True,
        "track": {"steps": 4, "batch": 4, "width": 8, **track},
    }
    values["data"] |= {"cameras": ["head_camera"], "image_size": [240, 320]}
    values["train"] |= {"disturb": 0.05}
    return parse_config(values, "test")


def test_a_run_that_was_stopped_finds_the_same_targets_and_a_policy_sees_them(
    dataset: Path, cache: Path, tmp_path: Path
):
    config = small(dataset, cache, touches=True)
    train(config, tmp_path / "whole", quiet=True)
    train(config, tmp_path / "parts", steps=3, quiet=True)
    train(config, tmp_path / "parts", quiet=True)
    files = ["model.safetensors", "preprocessing.json"]
    for name in files:
        whole, parts = (
            tmp_path / run / "checkpoints" / "step_00000006" / name for run in ("whole", "parts")
        )
        assert whole.read_bytes() == parts.read_bytes()
    found = replay_check(tmp_path / "whole", [dataset], 1)
    assert found["answers"] and not found["different"]
    policy = PumaPolicy.load(tmp_path / "whole")
    answers_together_are_those_alone(policy)
    executes_more_actions_while_the_target_is_still(policy)
    keeps_its_arms_until_others_are_much_likelier(policy)
    keeps_the_arms_that_it_has_chosen_in_time(policy)


def answers_together_are_those_alone(policy: PumaPolicy):
    """Also after a batch that failed, whose questions are asked again one by one."""
    alone = []
    for n in range(2):
        policy.reset(start())
        alone.append([policy.act(seen(k / 15, n)) for k in range(5)])
    episodes = [policy.begin(start()) for _ in range(2)]
    for k in range(5):
        asked = [(episode, seen(k / 15, n)) for n, episode in enumerate(episodes)]
        bad = policy.begin(start()), replace(seen(k / 15), images={})
        with pytest.raises(KeyError):
            policy.act_together([*asked, bad])
        for n, answer in enumerate(policy.act_together(asked)):
            np.testing.assert_array_equal(answer, alone[n][k])


def executes_more_actions_while_the_target_is_still(policy: PumaPolicy):
    policy.execute = policy.execute.model_copy(update={"actions": 2, "still": 4})
    for speed, actions in ((0.0, 4), (0.1, 2)):
        episode = policy.begin(start())
        assert episode.track is not None
        for k in range(12):
            points = pixels(0.05 + speed * k / 15, 0.05)
            episode.track.see(k / 15, points[[0, 1, 2, 1, 2]], EXACT[[0, 1, 2, 1, 2]])
        # a sighting of the time of the last one changes nothing
        policy.act_together([(episode, seen(11 / 15))])
        assert episode.due == pytest.approx((11 + actions) / 15)


def keeps_its_arms_until_others_are_much_likelier(policy: PumaPolicy):
    """And the arms decide what it does: the same glance has another answer with other arms."""
    episode, chooser, answers = policy.begin(start()), policy._network.chooser, []
    assert chooser is not None
    held = {name: value.clone() for name, value in chooser.state_dict().items()}
    for likely, chosen in (
        ([0.5, 0.4, 0.1], 0),
        ([0.3, 0.7, 0.0], 0),
        ([0.1, 0.9, 0.0], 1),
        ([0.6, 0.4, 0.0], 1),
    ):
        last = chooser.third
        assert isinstance(last, torch.nn.Linear)
        torch.nn.init.zeros_(last.weight)
        last.bias.data = torch.log(torch.tensor(likely) + 1e-6)
        episode.chunks.clear()
        answers.append(policy.act_together([(episode, seen(0.0))])[0])
        assert episode.choice == chosen
    chooser.load_state_dict(held)
    np.testing.assert_array_equal(answers[0], answers[1])
    assert np.abs(answers[2] - answers[1]).max() > 1e-6


def keeps_the_arms_that_it_has_chosen_in_time(policy: PumaPolicy):
    model = policy.config.model.model_copy(update={"choosing": 0.2})
    policy.config = policy.config.model_copy(update={"model": model})
    episode, chooser = policy.begin(start()), policy._network.chooser
    assert chooser is not None
    for time, likely, chosen in ((0.0, 0, 0), (0.1, 1, 1), (0.3, 0, 1)):
        chooser.third.bias.data = torch.eye(3)[likely] * 100
        episode.chunks.clear()
        policy.act_together([(episode, seen(time))])
        assert episode.choice == chosen


def test_arms_are_learned_from_the_moments_at_which_they_are_chosen(dataset: Path, cache: Path):
    values = small(dataset, cache).model_dump(mode="json")
    values["model"]["choosing"] = 0.2
    config = parse_config(values, "test")
    arrays = {"clock": np.array([0.0, 0.2, 0.4]), "choice": np.array([0, 1, 0])}
    arrays |= {"action": np.zeros((3, 2, 14)), "action_valid": np.ones((3, 2), bool)}
    network = build_model(config, Sizes(14, 0))
    likely = torch.tensor([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 5.0, 0.0]])
    outputs = Outputs(torch.zeros(3, 2, 14), None, likely)
    right = float(-likely.log_softmax(1)[0, 0])
    assert float(network.losses(outputs, targets_of(arrays, config))["choice"]) == pytest.approx(
        right
    )
    arrays["clock"] += 1
    assert float(network.losses(outputs, targets_of(arrays, config))["choice"]) == 0


def test_a_touch_is_learned_until_some_time_after_it(dataset: Path, cache: Path):
    values = small(dataset, cache).model_dump(mode="json")
    values["model"] |= {"touched": True, "touching": 0.4}
    config = parse_config(values, "test")
    found = since_touch(np.arange(6) / 5, np.array([True, True, False, False, True, False]))
    assert found == pytest.approx([0, 0, 0, 0.2, 0.4, 0.6])
    assert not since_touch(np.arange(3) / 5, np.ones(3, bool)).any()
    arrays = {"free": np.array([True, False, False]), "held": np.array([0.0, 0.4, 0.5])}
    arrays |= {"action": np.zeros((3, 2, 14)), "action_valid": np.ones((3, 2), bool)}
    network = build_model(config, Sizes(14, 0))
    # wrong by e^5 in the first and the last row
    outputs = Outputs(torch.zeros(3, 2, 14), None, touched=torch.tensor([5.0, 5.0, -5.0]))
    rows = [np.log1p(np.exp(5.0)), np.log1p(np.exp(-5.0))]
    loss = float(network.losses(outputs, targets_of(arrays, config))["touched"])
    assert loss == pytest.approx(sum(rows) / 3, rel=1e-5)


def test_grippers_stay_as_they_are_where_a_hand_may_hold_the_second_body(
    dataset: Path, cache: Path
):
    config = small(dataset, cache, goal=True)
    prep = open_corpus(small(dataset, cache)).preprocessing
    joints = np.tile(np.linspace(-0.4, 0.4, 14), (8, 1))
    joints[:, 6] = np.arange(8) / 8
    tools = tools_of(prep.embodiments[0], joints)
    track = np.zeros((8, 2, track_numbers(3)), np.float32)
    track[:, 1, :2] = 2.0
    track[:4, 1, :2] = tools[:4, 0, :2] + 0.05
    arrays = {"state": prep.state.forward(joints), "tools": tools, "free": np.ones(8, bool)}
    arrays |= {"action": np.zeros((8, 6, 14), np.float32), "track": track.reshape(8, -1)}
    Disturbance(0.05, config, prep).apply(arrays, np.random.default_rng(1))
    now = prep.state.backward(arrays["state"])[:, 6]
    assert now[:4] == pytest.approx(joints[:4, 6], abs=1e-6)
    assert np.ptp(np.sort(now[4:]) - joints[4:, 6]) < 1e-6 < np.ptp(now[4:] - joints[4:, 6])


def test_the_arms_of_an_episode_are_those_whose_joints_move():
    names = ("left_waist", "left_gripper", "right_waist", "right_gripper")
    moves = {"left": [0.5, 1, 0.01, 1], "right": [0.05, 0, 0.2, 0], "both": [0.5, 0, 0.5, 0]}
    for number, choice in enumerate(CHOICES):
        assert choice_of(names, np.linspace(0, 1, 5)[:, None] * moves[choice]) == number
    assert choice_of(names, np.zeros((5, 4))) == CHOICES.index("both")


def test_images_of_another_size_cannot_be_cropped(dataset: Path, cache: Path):
    values = small(dataset, cache).model_dump(mode="json")
    values["data"]["image_size"] = [48, 64]
    with pytest.raises(TrainError, match=r"set data\.image_size to \[240, 320\]"):
        open_corpus(parse_config(values, "test"))


def test_disturbed_joints_have_the_tools_and_the_actions_of_where_they_are(
    dataset: Path, cache: Path
):
    config = small(dataset, cache)
    prep: Preprocessing = open_corpus(config).preprocessing
    rng, joints = np.random.default_rng(1), np.tile(np.linspace(-0.4, 0.4, 14), (8, 1))
    joints[:, 6], joints[:, 13] = np.arange(8) / 8, 1 - np.arange(8) / 8
    commands = joints[:, None] + rng.normal(0, 0.1, (8, 6, 14))
    before = {
        "state": prep.state.forward(joints),
        "tools": tools_of(prep.embodiments[0], joints),
        "action": prep.action.forward(
            commands - np.where(np.arange(14) % 7 == 6, 0, joints)[:, None]
        ),
        "free": np.arange(8) != 3,
        "track": np.zeros((8, track_numbers(3)), np.float32),
    }
    after = dict(before)
    Disturbance(0.05, config, prep).apply(after, rng)
    now = prep.state.backward(after["state"])
    moved = np.abs(np.delete(now - joints, [6, 13], 1)).max(1)
    assert (
        moved[3] == pytest.approx(0, abs=1e-6) and (moved > 1e-3).sum() >= 4 and moved.max() < 0.3
    )
    # grippers are shuffled before the touch, each by itself: together they no longer tell anything
    # of the rest
    assert np.sort(now[:, [6, 13]], 0) == pytest.approx(np.sort(joints[:, [6, 13]], 0), abs=1e-6)
    assert (
        now[3, [6, 13]] == pytest.approx(joints[3, [6, 13]], abs=1e-6)
        and np.ptp(now[:, 6] + now[:, 13]) > 0.1
    )
    assert after["tools"] == pytest.approx(tools_of(prep.embodiments[0], now), abs=1e-6)
    meant = (
        prep.action.backward(after["action"]) + np.where(np.arange(14) % 7 == 6, 0, now)[:, None]
    )
    assert meant == pytest.approx(commands, abs=1e-4)
