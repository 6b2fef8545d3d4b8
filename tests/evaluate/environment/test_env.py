"""The environment: gymnasium's own checker, and recorded actions, which must suffice to imitate."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import DEFAULT
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate import env_id
from pipeline.evaluate.actions import ActionError, ToolPoses, interpolate_targets, joint_limits
from pipeline.evaluate.scenes.benchmark import read_benchmark
from pipeline.evaluate.scenes.case import BLIND, admit, expert, expert_actions, log_hash, start_hash
from pipeline.evaluate.scenes.trial import Trial
from pipeline.planning.planner import planner_for
from pipeline.poses import compose, inverse, quat_rotate
from pipeline.stages.failure import Failure
from pipeline.tasks import TASKS
from pipeline.world.cameras import cameras_of
from pipeline.world.robots import get_embodiment


def case_of(task, level=1, embodiment="aloha-agilex", alpha=0.1, first=100_000, setup=DEFAULT):
    """The first case of a cell that the expert solves."""
    for seed in range(first, first + 5):
        try:
            return admit(EpisodeSpec(task, embodiment, level, alpha, "clean", 0, seed), setup)
        except Failure:
            continue
    raise AssertionError(f"the expert solves none of five scenes of {task}")


def make(task, level=1, setup=BLIND, **options):
    return gymnasium.make(
        env_id(task), level=level, setup=setup, disable_env_checker=True, **options
    )


def play(env, case, actions):
    """Reset to the case, play actions (T,A) and then hold the last one; the last info."""
    _, info = env.reset(options={"case": case})
    for n in range(10_000):
        _, reward, terminated, truncated, info = env.step(actions[min(n, len(actions) - 1)])
        if terminated or truncated:
            return info, reward
    raise AssertionError("the episode does not end")


def test_every_task_is_registered():
    assert {env_id(task) for task in TASKS} <= set(gymnasium.registry)


@pytest.mark.parametrize(
    "options", [{"actions": "ee"}, {"observations": "state", "reward": "dense"}]
)
def test_gymnasiums_checker_passes_without_images(options):
    env = make("click_bell", **options)
    spaces = env.observation_space.values() if "actions" in options else [env.observation_space]
    assert all(space.is_bounded() for space in spaces if isinstance(space, gymnasium.spaces.Box))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env.unwrapped, skip_render_check=True)


def test_gymnasiums_checker_passes_with_images_and_rendering():
    env = make("click_bell", setup={"cameras": ["head", "left"]}, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env.unwrapped)
    observation, info = env.reset(seed=3)
    assert observation["pixels"]["head_camera"].shape == (240, 320, 3)
    assert set(observation["pixels"]) == {"head_camera", "left_camera"}
    assert np.array_equal(env.render(), observation["pixels"]["head_camera"])
    assert observation["instruction"] == info["task_description"] != ""
    env.close()


def test_depth_is_the_distance_along_the_viewing_axis():
    env = make("click_bell", setup={"cameras": ["head"], "depth": True})
    observation, _ = env.reset(options={"case": case_of("click_bell")})
    depth = observation["depth"]["head_camera"]
    assert (depth.dtype, depth.shape) == (np.uint16, (240, 320))
    assert env.observation_space.contains(observation)
    scene = env.unwrapped.trial.scene
    camera = cameras_of(scene.embodiment)[0]
    # the ray of a pixel that shows the bare table (x forward, y left, z up in the camera) meets its
    # plane there
    focal = 120 / np.tan(np.radians(37.0) / 2)
    for u, v in ((20, 40), (80, 130), (260, 220)):
        ray = quat_rotate(camera.pose[3:], [1.0, (160 - u - 0.5) / focal, (120 - v - 0.5) / focal])
        assert depth[v, u] / 1000 == pytest.approx((0.74 - camera.pose[2]) / ray[2], abs=0.002)
    env.close()


CELLS = [
    ("click_bell", 1),
    ("place_container_plate", 3),
    ("shake_bottle", 2),
    ("grab_roller", 1),
    ("handover_block", 3),
    ("beat_block_hammer", 2),
]


@pytest.mark.parametrize(("task", "level"), CELLS)
def test_recorded_actions_suffice_to_imitate(task, level):
    case = case_of(task, level)
    # as they are stored for training: float32
    info, reward = play(make(task, level), case, expert_actions(case).astype(np.float32))
    assert info["is_success"], info["score"]
    assert info["score"]["route_completion"] == 100
    assert reward == info["score"]["manipulation_score"] == 100
    assert info["score"]["failed"] == ()


def test_a_robot_that_does_nothing_fails_by_the_clock():
    case = case_of("click_bell", 0)
    env = make("click_bell", 0)
    info, _ = play(env, case, home(env, case))
    assert info["ending"] == "time_limit"
    assert info["score"]["seconds"] == pytest.approx(TASKS["click_bell"].step_limit / 15)
    assert info["score"]["failure"] == "missed"
    assert "touched" in info["score"]["failed"]


def home(env, case):
    env.reset(options={"case": case})
    return env.unwrapped.trial.simulation.home_vector()[None]


def test_a_target_that_nobody_meets_leaves_the_view():
    case = case_of("click_bell", 1)
    env = make("click_bell", 1)
    info, reward = play(env, case, home(env, case))
    assert info["ending"] == "out_of_view"
    assert info["score"]["failure"] == "out_of_view"
    assert info["score"]["penalties"] == ("out_of_bounds",)
    assert reward == pytest.approx(info["score"]["route_completion"] / 2)


def test_the_recorded_tool_poses_suffice_as_well():
    case = case_of("click_bell", 1)
    robot, planner = get_embodiment("aloha"), planner_for("aloha-agilex")
    rows = []
    for action in expert_actions(case):
        rows.append(
            np.concatenate(
                [
                    np.append(planner.fk(side, q), value)
                    for side, (q, value) in planner.split(action).items()
                ]
            )
        )
    info, _ = play(make("click_bell", actions="ee"), case, np.array(rows))
    assert info["is_success"]
    env = make("click_bell", actions="delta_ee")
    env.reset(options={"case": case})
    simulation = env.unwrapped.trial.simulation
    for row in rows:
        tools = [simulation.tcp(side) for side in robot.sides]
        poses = [
            np.append(compose(inverse(tools[i]), row[8 * i : 8 * i + 7]), row[8 * i + 7])
            for i in range(2)
        ]
        _, _, ended, _, info = env.step(np.concatenate(poses).astype(np.float32))
        if ended:
            break
    assert info["is_success"]
    joints, missed = ToolPoses(robot).joints(rows[0], home(make("click_bell"), case)[0])
    np.testing.assert_allclose(joints, expert_actions(case)[0], atol=2e-3)
    assert missed == ()


def test_a_tool_pose_out_of_reach_holds_that_arm_still():
    tools, home_vector = ToolPoses(get_embodiment("aloha")), np.zeros(14)
    far = np.array([3.0, 3, 3, 1, 0, 0, 0, 0.5] * 2)
    joints, missed = tools.joints(far, home_vector)
    assert missed == ("left", "right")
    assert joints[6] == joints[13] == 0.5
    assert not joints[:6].any()


def test_the_same_case_is_the_same_world():
    case = case_of("click_bell", 1)
    env = make("click_bell")
    env.reset(options={"case": case})
    simulation = env.unwrapped.trial.simulation
    assert start_hash(simulation.poses(), simulation.qpos()[0]) == case.start
    assert log_hash(expert(case.spec).replay.log) == case.end
    assert type(case).from_dict(case.to_dict()) == case


def test_scenes_of_a_benchmark_come_in_turn():
    cell = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
    frozen = read_benchmark("domino-v1").cases([cell], 50)[cell]
    env = make("click_bell", benchmark="domino-v1")
    seeds = []
    for seed in (48, None, None, 53):
        _, info = env.reset(seed=seed)
        seeds.append(env.unwrapped.case.spec.seed)
        assert info["task_description"] == env.unwrapped.task_description != ""
    assert seeds == [frozen[n].spec.seed for n in (48, 49, 0, 3)]
    log = Trial(frozen[3].scene(BLIND), frozen[3].target_motion, BLIND).recorder.log()
    assert np.array_equal(env.unwrapped.trial.recorder.log().poses[0], log.poses[0])
    with pytest.raises(DominoError, match="no cell"):
        make("click_bell", benchmark="domino-v1", domain="randomized")


def test_interpolation_is_linear_and_ends_at_the_action():
    before, action = np.array([0.0, 1.0]), np.array([0.16, 0.2])
    rows, velocity = interpolate_targets(before, action, 16, 1 / 15)
    np.testing.assert_allclose(rows[:, 0], 0.01 * np.arange(1, 17))
    np.testing.assert_allclose(velocity, [2.4, -12.0])
    assert (rows[-1] == action).all()


def test_actions_are_clipped_to_what_the_joints_can_do():
    case = case_of("click_bell", 1)
    env = make("click_bell")
    env.reset(options={"case": case})
    trial, limits = env.unwrapped.trial, joint_limits(get_embodiment("aloha"))
    before = trial.simulation.command.copy()
    trial.advance(np.full(14, 100.0))
    moved = trial.simulation.command - before
    arm = np.isfinite(limits.speed)
    assert (moved[arm] <= limits.speed[arm] / 15 + 1e-12).all()
    assert (moved[arm] > 0).all()
    assert trial.simulation.command[6] == 1


@pytest.mark.parametrize(
    "action", [np.zeros(13), np.full(14, np.nan), np.zeros((1, 14)), ["a"] * 14]
)
def test_an_action_that_is_none_is_refused(action):
    env = make("click_bell")
    env.reset(options={"case": case_of("click_bell", 1)})
    with pytest.raises(ActionError):
        env.step(action)


@pytest.mark.parametrize(
    "bad",
    [
        {"setup": {"cameras": ["third_eye"]}},
        {"setup": {"speed": 3}},
        {"actions": "torque"},
        {"level": 4},
        {"domain": "moon"},
        {"alpha": -1},
    ],
)
def test_an_option_that_does_not_exist_is_refused(bad):
    with pytest.raises(ValueError, match=r"unknown|speed|third_eye"):
        make("click_bell", **bad)


def test_the_world_goes_on_while_the_robot_holds():
    case = case_of("click_bell", 1)
    env = make("click_bell")
    env.reset(options={"case": case})
    trial: Trial = env.unwrapped.trial
    command = trial.simulation.command.copy()
    trial.hold(12)
    assert trial.time == pytest.approx(0.05)
    assert (trial.simulation.command == command).all()
    np.testing.assert_allclose(
        trial.simulation.pose("bell")[:3], case.target_motion.position(0.05), atol=1e-6
    )
