"""Policies written for other projects: stand-ins that play the expert's actions must succeed as the
expert does."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.episode import EpisodeJob, run_episode, start_of
from pipeline.evaluate.names import make_here, policy_name
from pipeline.evaluate.policies.lerobot import LerobotPolicy
from pipeline.evaluate.policies.policy import Observation, PolicyError, Start
from pipeline.evaluate.policies.robotwin import RobotwinRobot, robot_at
from pipeline.evaluate.policies.turns import Turns
from pipeline.evaluate.policies.xpolicylab import XPolicyLabRobot
from pipeline.evaluate.scenes.case import BLIND, expert, expert_actions
from pipeline.evaluate.scenes.trial import FAULTS
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.session import EpisodeMessage
from pipeline.export.bridges.robotwin import drive_targets, tool_poses
from pipeline.motion.planar import PlanarMotion
from pipeline.planning.planner import planner_for
from pipeline.poses import compose, inverse
from pipeline.stages.scene import build_scene
from pipeline.stages.surroundings import table_drop
from pipeline.world.robots import get_embodiment
from tests.evaluate.environment.test_env import case_of

NAMES = get_embodiment("aloha").vector_names

DEPLOY = """
import numpy as np
from .model import Recorded

def encode_obs(observation):
    return observation["joint_action"]["vector"]

def get_model(usr_args):
    assert usr_args["left_arm_dim"] == usr_args["right_arm_dim"] == 6 and usr_args["seed"] == 3
    return Recorded(np.load(usr_args["actions"]), usr_args["horizon"])

def eval(TASK_ENV, model, observation):
    assert TASK_ENV.get_instruction() == observation["instruction"] != ""
    model.look(encode_obs(observation))
    for action in model.get_action():
        TASK_ENV.take_action(action, action_type=model.action_type)
        model.look(encode_obs(TASK_ENV.get_obs()))

def reset_model(model):
    model.at = 0
"""
MODEL = """
class Recorded:
    def __init__(self, actions, horizon):
        self.actions, self.horizon, self.at, self.seen = actions, horizon, 0, []
        self.action_type = "qpos" if actions.shape[1] == 14 else "ee"

    def look(self, vector):
        assert vector.shape == (14,)

    def get_action(self):
        rows = self.actions[self.at : self.at + self.horizon]
        self.at += self.horizon
        return rows if len(rows) else self.actions[-1:]
"""


def package(tmp_path, name, actions, deploy=DEPLOY):
    folder = tmp_path / "policy" / name
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("from .deploy_policy import *\n")
    (folder / "model.py").write_text(MODEL)
    (folder / "deploy_policy.py").write_text(deploy)
    (folder / "deploy_policy.yml").write_text("horizon: 5\nseed: 3\npolicy_name: Recorded\n")
    np.save(tmp_path / "actions.npy", actions)
    return f"robotwin:{folder}?actions={tmp_path / 'actions.npy'}"


def episode(text, case, setup=BLIND):
    return run_episode(
        EpisodeJob(
            case, replace(policy_name(text), process="evaluator"), parse_clock("sim"), setup=setup
        )
    )


@pytest.mark.parametrize("name", ["Played", "PlayedPoses"])
def test_a_deploy_policy_of_robotwin_runs_unmodified(tmp_path, name):
    case = case_of("click_bell", 1)
    actions = expert_actions(case)
    if name == "PlayedPoses":
        # the original's tool poses: 0.12 m behind the tool centre point
        planner, rows = planner_for("aloha-agilex"), []
        for action in actions:
            parts = planner.split(action)
            poses = [
                np.append(compose(planner.fk(s, q), [-0.12, 0, 0, 1, 0, 0, 0]), value)
                for s, (q, value) in parts.items()
            ]
            rows.append(np.concatenate(poses))
        actions = np.array(rows)
    text = package(tmp_path, name, actions)
    row = episode(text + "&horizon=7", case)
    assert row["success"] and row["asked"] == row["periods"]
    assert row["policy"].startswith(f"robotwin:{name}@") and "horizon=7" in row["policy"]
    assert policy_name(text).label != row["policy"]


PAIRS = """
import numpy as np

def get_model(usr_args):
    return np.load(usr_args["actions"])

def eval(TASK_ENV, model, observation):
    t = min(TASK_ENV.take_action_cnt, len(model) - 2)
    assert TASK_ENV.take_action_cnt > t or np.array_equal(observation["joint_action"]["vector"], model[t])
    TASK_ENV.take_action(model[t + 1])
"""  # noqa: E501


def test_training_pairs_and_task_env_agree(tmp_path):
    """What a stock converter calls state t and action t is what TASK_ENV shows and takes t actions
    into the same episode."""
    case = case_of("click_bell", 1)
    log = expert(case.spec, case.setup).replay.log
    row = episode(package(tmp_path, "Pairs", drive_targets(log.state, log.action), PAIRS), case)
    assert row["success"] and row["asked"] == row["periods"] > 20


def test_several_episodes_reset_one_model(tmp_path):
    case = case_of("click_bell", 1)
    policy = make_here(policy_name(package(tmp_path, "Twice", expert_actions(case))))
    start = Start("press", "aloha-agilex", NAMES, 15, (), 0)
    firsts = []
    for _ in range(3):
        policy.reset(start)
        firsts.append([np.asarray(policy.act(look(time=n / 15))) for n in range(7)])
    assert np.array_equal(firsts[0], expert_actions(case)[:7])
    assert np.array_equal(firsts[0], firsts[1]) and np.array_equal(firsts[0], firsts[2])
    # seven actions are two chunks of five, each of one call of eval
    assert policy.inferences == 3 * 2


def look(time=0.0, **images):
    return Observation(np.linspace(0, 0.3, 14), "press", time, images)


def test_observations_and_actions_are_those_of_the_original():
    robot, planner = RobotwinRobot(get_embodiment("aloha")), planner_for("aloha-agilex")
    image = np.full((2, 2, 3), 7, np.uint8)
    seen, command = look(time=0.4, head_camera=image), np.linspace(0.2, 0.4, 14)
    told = robot.observation(seen, command)
    assert told["observation"]["head_camera"]["rgb"] is image
    assert (
        told["joint_action"]["left_arm"] + [told["joint_action"]["left_gripper"]]
        == command[:7].tolist()
    )
    assert np.array_equal(told["joint_action"]["vector"], command)
    assert (
        told["endpose"]["left_gripper"] == command[6]
        and told["endpose"]["right_gripper"] == command[13]
    )
    tool, behind = (
        planner.fk("right", seen.joints[7:13]),
        np.array(told["endpose"]["right_endpose"]),
    )
    # 0.12 m along the tool's x axis
    np.testing.assert_allclose(compose(inverse(behind), tool)[:3], [0.12, 0, 0], atol=1e-12)
    still = np.array([0, 0, 0, 1, 0, 0, 0, 0.5] * 2)
    moved = robot.joints(still, "delta_ee", seen.joints, seen.joints)
    np.testing.assert_allclose(
        np.delete(moved, [6, 13]), np.delete(seen.joints, [6, 13]), atol=1e-3
    )
    assert moved[6] == moved[13] == 0.5
    forward = still.copy()
    forward[8] = 0.03
    home = np.concatenate([np.append(planner.home(side), 1.0) for side in ("left", "right")])
    tool = planner.fk("right", home[7:13])
    there = planner.fk("right", robot.joints(forward, "delta_ee", home, home)[7:13])
    np.testing.assert_allclose(compose(inverse(tool), there)[:3], [0.03, 0, 0], atol=1e-3)


def test_tool_poses_are_those_over_the_lowered_table():
    """In the randomized domain, as in the files of `export --format robotwin` and `xpolicylab`."""
    spec = EpisodeSpec("click_bell", "aloha-agilex", 0, 0.1, "randomized", 0, 7)
    scene = build_scene(spec)
    simulation = scene.start(
        PlanarMotion.still(scene.bodies["bell"].pose, 1.0), 15, "test"
    ).simulation
    start = start_of(scene.embodiment, BLIND, "press")
    assert abs(start.lift - table_drop(spec)) < 1e-4 and start.lift > 0.001
    assert EpisodeMessage.of(start).start() == start
    joints = simulation.state_vector(simulation.qpos()[0])
    seen = Observation(joints, "press", 0.0)
    tcps = [simulation.tcp(side) for side in ("left", "right")]
    endpose = RobotwinRobot(robot_at(start)).observation(seen, joints)["endpose"]
    state = XPolicyLabRobot(robot_at(start)).observation(seen, joints, 15)["state"]
    for i, side in enumerate(("left", "right")):
        behind = tool_poses(tcps[i])
        for given, true in (
            (np.array(endpose[f"{side}_endpose"]), behind),
            (state[f"{side}_ee_pose"], behind),
            (state[f"{side}_tcp_pose"], tcps[i]),
        ):
            np.testing.assert_allclose(given[:3], true[:3], atol=1e-4)
            assert abs(given[3:] @ true[3:]) > 1 - 1e-6


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("pass", "without taking an action"),
        ("TASK_ENV.take_action([0.0] * 3)", r"shape \(3,\)"),
        ("TASK_ENV.take_action([0.0] * 14, action_type='torque')", "'torque' is unknown"),
        ("TASK_ENV.take_action([0.0] * 16, action_type='ee')", "quaternion"),
        ("TASK_ENV.robot.left_arm", "TASK_ENV has no robot"),
        ("raise KeyError('weights')", "KeyError: 'weights'"),
    ],
)
def test_what_a_deploy_policy_does_wrong_is_one_line(tmp_path, line, said):
    deploy = f"def get_model(usr_args): return 1\ndef eval(TASK_ENV, model, observation): {line}\n"
    name = "Wrong" + "".join(filter(str.isalpha, said))
    text = package(tmp_path, name, np.zeros(1), deploy)
    row = episode(text, case_of("click_bell", 1))
    assert row["ending"] in FAULTS and re.search(said, row["fault"]) and "\n" not in row["fault"]


def test_turns_end_wherever_they_wait():
    ended = []

    def work(turns):
        try:
            seen = turns.first()
            while True:
                try:
                    seen = turns.after(seen.time + 1)
                except Exception:  # noqa: BLE001 (what code of others does)
                    continue
        finally:
            ended.append(True)

    turns = Turns(work)
    assert [turns.ask(look(time=t)) for t in (0.0, 5.0)] == [1.0, 6.0]
    turns.end()
    assert ended == [True]
    once = Turns(lambda turns: None)
    assert once.ask(look()) is None and once.ask(look()) is None


XPOLICY = """
import numpy as np
SIDES = ("left", "right")
class Model:
    def __init__(self, settings):
        self.rows, self.length = np.load(settings["actions"]), settings.get("length", 4)
        self.keyed = settings.get("keyed", False)
    def reset(self): self.at = 0
    def update_obs(self, observation):
        assert observation["data_format_version"] == "v1.0" and observation["additional_info"] == {"frequency": 15}
        state = observation["state"]
        joints = [state[f"{side}_{part}_joint_state"] for side in SIDES for part in ("arm", "ee")]
        self.vector = np.concatenate(joints)
        # in force is what was commanded last, as in the files that policies are trained on
        if 0 < self.at <= len(self.rows):
            np.testing.assert_array_equal(self.vector, self.rows[self.at - 1].astype(np.float32))
        assert np.linalg.norm(state["left_ee_pose"][:3] - state["left_tcp_pose"][:3]) - 0.12 < 1e-6
    def get_action(self):
        self.at += self.length
        rows = self.rows[self.at - self.length : self.at]
        rows = rows if len(rows) else self.vector[None]
        keys = ("left_arm_joint_state", "left_ee_joint_state", "right_arm_joint_state", "right_ee_joint_state")
        return [dict(zip(keys, np.split(row, [6, 7, 13]))) for row in rows] if self.keyed else rows
"""  # noqa: E501


@pytest.mark.parametrize("keyed", ["false", "true"])
def test_a_model_of_xpolicylab_runs(tmp_path, keyed):
    case, path = case_of("click_bell", 1), tmp_path / "model.py"
    path.write_text(XPOLICY)
    np.save(tmp_path / "actions.npy", expert_actions(case))
    row = episode(
        f"xpolicylab:{path}?actions={tmp_path / 'actions.npy'}&length=6&keyed={keyed}", case
    )
    assert row["success"] and row["asked"] == -(-row["periods"] // 6)


def test_a_model_without_the_methods_is_one_line(tmp_path):
    path = tmp_path / "model.py"
    path.write_text("class Model:\n    def reset(self): pass\n")
    with pytest.raises(PolicyError, match="has no method update_obs"):
        make_here(policy_name(f"xpolicylab:{path}"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robotwin:", "write robotwin:PATH"),
        ("robotwin:/nowhere", "there is no deploy_policy.py"),
        ("robotwin:x?y", "write robotwin:PATH"),
        ("xpolicylab:/nowhere.py", "cannot be read"),
        ("lerobot:/nowhere", "no directory"),
        ("lerobot:a/b?wings=2", "option 'wings' is unknown"),
    ],
)
def test_a_name_that_leads_nowhere_is_one_line(text, said):
    with pytest.raises(PolicyError, match=said) as error:
        policy_name(text)
    assert "\n" not in str(error.value)


# --- LeRobot
# ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def act_directory(tmp_path_factory):
    """A tiny ACT with random weights for the head camera at 24x32, saved as lerobot saves policies;
    and its statistics."""
    pytest.importorskip("lerobot")
    import torch
    from lerobot.configs import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    torch.manual_seed(0)
    config = ACTConfig(
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (14,)),
            "observation.images.cam_high": PolicyFeature(FeatureType.VISUAL, (3, 24, 32)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (14,))},
        device="cpu",
        chunk_size=60,
        n_action_steps=50,
        dim_model=32,
        n_heads=2,
        dim_feedforward=32,
        n_encoder_layers=1,
        n_decoder_layers=1,
        use_vae=False,
        pretrained_backbone_weights=None,
    )
    one, image = torch.ones(14), torch.ones(3, 1, 1)
    stats = {
        "observation.state": {"mean": one * 0.1, "std": one * 2},
        "observation.images.cam_high": {"mean": image * 0.5, "std": image * 0.25},
        "action": {"mean": torch.arange(14) / 10, "std": one * 0.05},
    }
    folder = tmp_path_factory.mktemp("act") / "tiny"
    policy = get_policy_class("act")(config)
    policy.save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)
    return folder


def test_a_policy_of_lerobot_answers_what_its_network_says(act_directory):
    import torch

    policy = make_here(policy_name(f"lerobot:{act_directory}?device=cpu"))
    image = np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8)
    policy.reset(
        Start("press", "aloha-agilex", NAMES, 15, ("head_camera",), 0, {"head_camera": (24, 32)})
    )
    answer = policy.act(look(head_camera=image))
    assert policy.inferences == 1
    batch = {
        "observation.state": torch.tensor((look().joints - 0.1) / 2, dtype=torch.float32)[None],
        "observation.images.cam_high": torch.tensor(
            (image.transpose(2, 0, 1) / 255 - 0.5) / 0.25, dtype=torch.float32
        )[None],
    }
    by_hand = policy._policy.predict_action_chunk(batch)[0].numpy() * 0.05 + np.arange(14) / 10
    assert answer.shape == (50, 14)
    np.testing.assert_allclose(answer, by_hand[:50], atol=1e-5)


def test_a_diffusion_policy_of_lerobot_is_charged_once_for_its_actions():
    """The network runs many times for an answer, and looks at two observations."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("diffusers")
    pytest.importorskip("lerobot")
    from lerobot.configs import FeatureType, PolicyFeature
    from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    torch.manual_seed(0)
    config = DiffusionConfig(
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (14,)),
            "observation.images.cam_high": PolicyFeature(FeatureType.VISUAL, (3, 64, 64)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (14,))},
        device="cpu",
        horizon=8,
        n_action_steps=2,
        down_dims=(8, 16),
        n_groups=2,
        kernel_size=3,
        diffusion_step_embed_dim=8,
        spatial_softmax_num_keypoints=2,
        num_inference_steps=2,
        crop_shape=None,
        pretrained_backbone_weights=None,
    )
    one, image = torch.ones(14), torch.ones(3, 1, 1)
    stats = {
        "observation.state": {"min": -one, "max": one},
        "observation.images.cam_high": {"mean": image * 0.5, "std": image * 0.25},
        "action": {"min": -one, "max": one},
    }
    policy = LerobotPolicy(
        get_policy_class("diffusion")(config).eval(),
        make_pre_post_processors(config, dataset_stats=stats),
        False,
    )
    policy.reset(
        Start("press", "aloha-agilex", NAMES, 15, ("head_camera",), 0, {"head_camera": (64, 64)})
    )
    counts = []
    for n in range(5):
        assert policy.act(look(time=n / 15, head_camera=np.zeros((64, 64, 3), np.uint8))).shape == (
            1,
            14,
        )
        counts.append(policy.inferences)
    assert counts == [1, 1, 2, 2, 3]


def test_a_network_is_charged_however_it_is_run_and_cameras_may_be_renamed_or_empty():
    """As SmolVLA's: select_action calls a method of its own, which runs layers and not a forward of
    the policy."""
    torch = pytest.importorskip("torch")

    class Network(torch.nn.Module):
        def __init__(self):
            super().__init__()
            shapes = {
                "observation.images.camera1": (3, 24, 32),
                "observation.images.empty_camera_0": (3, 8, 8),
            }
            images = {key: SimpleNamespace(shape=shape) for key, shape in shapes.items()}
            self.config = SimpleNamespace(
                image_features=images,
                input_features={},
                output_features={},
                n_obs_steps=1,
                n_action_steps=2,
                empty_cameras=1,
            )
            self.inner, self.queue = torch.nn.Sequential(torch.nn.Linear(14, 14)), []

        def reset(self):
            self.queue.clear()

        def sample_actions(self, batch):
            assert set(batch) == {"observation.state", "task", "observation.images.camera1"}
            return [self.inner[0](batch["observation.state"]) for _ in range(5)]

        def select_action(self, batch):
            self.queue = self.queue or self.sample_actions(batch)
            return self.queue.pop()

    rename = {"observation.images.cam_high": "observation.images.camera1"}

    class Renaming:
        steps = (SimpleNamespace(rename_map=rename), SimpleNamespace())

        def reset(self): ...

        def __call__(self, batch):
            return {rename.get(key, key): value for key, value in batch.items()}

    class Unchanged(Renaming):
        def __call__(self, action):
            return action

    policy = LerobotPolicy(Network(), (Renaming(), Unchanged()), False)
    policy.reset(
        Start("press", "aloha-agilex", NAMES, 15, ("head_camera",), 0, {"head_camera": (24, 32)})
    )
    counts = []
    for _ in range(4):
        assert policy.act(look(head_camera=np.zeros((24, 32, 3), np.uint8))).shape == (2, 14)
        counts.append(policy.inferences)
    # five actions a run, two of them an answer
    assert counts == [1, 1, 2, 2]


def test_a_policy_of_lerobot_is_evaluated(act_directory):
    case = case_of("click_bell", 1)
    row = episode(f"lerobot:{act_directory}?device=cpu&resize=true", case, Setup(cameras=("head",)))
    assert row["policy"].startswith("lerobot:tiny@")
    assert row["asked"] == -(-row["periods"] // 50)
    assert json.loads(json.dumps(row)) == row


@pytest.mark.parametrize(
    ("sizes", "names", "both"),
    [
        ({"head_camera": (240, 320)}, NAMES, ("32x24", "320x240")),
        ({"left_camera": (24, 32)}, NAMES, ("head_camera", "left_camera")),
        ({"head_camera": (24, 32)}, NAMES[:7], ("14", "7")),
    ],
)
def test_what_a_policy_of_lerobot_was_not_made_for_is_refused(act_directory, sizes, names, both):
    policy = make_here(policy_name(f"lerobot:{act_directory}?device=cpu"))
    with pytest.raises(PolicyError) as error:
        policy.reset(Start("press", "aloha-agilex", names, 15, tuple(sizes), 0, sizes))
    assert all(value in str(error.value) for value in both)


def test_a_directory_that_holds_no_policy_is_one_line(act_directory, tmp_path):
    with pytest.raises(PolicyError, match=r"has no config\.json"):
        policy_name(f"lerobot:{tmp_path}")
    (tmp_path / "config.json").write_text('{"type": "telepathy"}')
    with pytest.raises(PolicyError, match="cannot be loaded") as error:
        make_here(policy_name(f"lerobot:{tmp_path}"))
    assert "\n" not in str(error.value)
