"""A policy whose actions are tool poses or differences: the evaluator turns them into joints with
the state at which it asked, and counts the poses out of reach."""

from dataclasses import astuple
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.commands.evaluate import describe
from pipeline.data.actions import ACTIONS, JOINTS, ActionCodec, Representation
from pipeline.data.chains import read_chains
from pipeline.evaluate import asking
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.policies.contract import Contract, action_length, check_contract
from pipeline.evaluate.policies.lerobot import LerobotPolicy
from pipeline.evaluate.policies.policy import Observation, PolicyError, PolicyName, Start
from pipeline.evaluate.scenes.case import expert_actions
from pipeline.evaluate.scenes.trial import INVALID_ACTION
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.summary import summarise
from pipeline.world.robots import get_embodiment
from tests.evaluate.environment.test_env import case_of

NAMES = get_embodiment("aloha-agilex").vector_names


@pytest.fixture
def named(monkeypatch):
    """A function that names a policy of this process."""
    monkeypatch.setattr(asking, "make_policy", lambda name: policies[name.text])
    asking._load.cache_clear()
    policies = {}

    def name(policy):
        policies["x"] = policy
        return PolicyName("x", "x", process="evaluator")

    yield name
    asking._load.cache_clear()


class Recorded:
    """Answers with chunks of the expert's actions, written as a network would have learnt them: in
    float32, against the state that it is shown."""

    def __init__(self, representation, case, chunk):
        self.contract = Contract(None, None, None, chunk, *astuple(representation))
        self._codec = ActionCodec(representation, NAMES, read_chains("aloha-agilex"))
        self._actions, self._chunk = expert_actions(case), chunk

    def reset(self, start):
        self._at, self._before = 0, None

    def act(self, observation):
        rows = self._actions[self._at : self._at + self._chunk]
        rows = rows if len(rows) else self._actions[-1:]
        before = observation.joints if self._before is None else self._before
        self._at, self._before = self._at + self._chunk, rows[-1]
        against = np.vstack([before, rows[:-1]])
        if self.contract.actions.reference != "delta":
            against = np.broadcast_to(observation.joints, rows.shape)
        return self._codec.encode(rows, against).astype(np.float32)


@pytest.mark.parametrize(
    ("actions", "chunk"), [*product(ACTIONS, [16]), ("ee", 1), ("ee-relative", 1)]
)
def test_recorded_actions_succeed_in_every_representation(named, actions, chunk):
    case = case_of("click_bell", 1)
    representation = Representation(actions, "6d" if chunk > 1 else "axis-angle", "base")
    job = EpisodeJob(case, named(Recorded(representation, case, chunk)), parse_clock("sim"))
    row = run_episode(job)
    assert row["success"]
    assert row.get("unreachable", 0) == 0
    assert ("unreachable" in row) == (representation != JOINTS)


def test_poses_out_of_reach_are_counted_and_shown(named):
    far = np.array([5.0, 0, 0, 1, 0, 0, 0, 0.5] * 2)
    policy = SimpleNamespace(
        reset=lambda start: None, act=lambda o: far, contract=Contract(representation="ee")
    )
    row = run_episode(EpisodeJob(case_of("click_bell", 1), named(policy), parse_clock("sim")))
    assert row["unreachable"] == 2 * row["asked"] > 0
    (cell,) = summarise([row])
    assert cell["unreachable"] == row["unreachable"]
    assert f"unreachable poses {row['unreachable']}" in describe([cell], [])


def test_a_rotation_without_direction_is_no_action(named):
    policy = SimpleNamespace(
        reset=lambda start: None,
        act=lambda o: np.zeros(20),
        contract=Contract(representation="ee", rotation="6d"),
    )
    row = run_episode(EpisodeJob(case_of("click_bell", 1), named(policy), parse_clock("sim")))
    assert row["ending"] == INVALID_ACTION


def test_a_contract_states_representation_rotation_and_frame():
    contract = Contract(representation="ee-delta", rotation="axis-angle", frame="base")
    policy: Any = SimpleNamespace(contract=contract)
    assert contract.actions == Representation("ee-delta", "axis-angle", "base")
    assert action_length(policy, NAMES) == 14
    assert contract.to_dict()["rotation"] == "axis-angle"
    assert "rotation" not in Contract().to_dict()
    start: Any = SimpleNamespace(action_names=NAMES, setup=None)
    policy.contract = Contract(representation="poses")
    with pytest.raises(PolicyError, match="actions 'poses' is unknown"):
        check_contract(policy, start)


class Still:
    """A network that always answers with the same numbers."""

    def __init__(self, torch, answer):
        self.config = SimpleNamespace(
            image_features={},
            input_features={},
            output_features={},
            n_obs_steps=1,
            n_action_steps=3,
        )
        self._answer = torch.tensor(np.asarray(answer, np.float32)[None])

    def modules(self):
        return ()

    def reset(self): ...

    def select_action(self, batch):
        return self._answer


def test_lerobots_relative_actions_are_against_the_state_that_was_asked_at():
    """Its own processor steps, unchanged: the answer 0.1 is 0.1 rad from the state, and grippers
    are absolute."""
    torch = pytest.importorskip("torch")
    from lerobot.processor import (
        AbsoluteActionsProcessorStep,
        PolicyProcessorPipeline,
        RelativeActionsProcessorStep,
    )
    from lerobot.processor.converters import (
        policy_action_to_transition,
        transition_to_policy_action,
    )

    relative = RelativeActionsProcessorStep(True, ["gripper"], list(NAMES))
    absolute = AbsoluteActionsProcessorStep(True, relative)
    after: Any = PolicyProcessorPipeline(
        [absolute], to_transition=policy_action_to_transition, to_output=transition_to_policy_action
    )
    before: Any = PolicyProcessorPipeline([relative])
    policy = LerobotPolicy(Still(torch, np.full(14, 0.1)), (before, after), False)
    policy.reset(Start("press", "aloha-agilex", NAMES, 15, (), 0))
    for low in (-1.0, 2.0):
        joints = low + np.linspace(0, 1, 14).astype(np.float64)
        moved = np.where([n.endswith("gripper") for n in NAMES], 0.1, joints + 0.1)
        answer = np.asarray(policy.act(Observation(joints, "press", 0.0)))
        assert np.allclose(answer, np.tile(moved, (3, 1)), atol=1e-6)


def test_a_lerobot_policy_takes_its_representation_from_an_export(tmp_path):
    (tmp_path / "act").mkdir()
    (tmp_path / "act" / "config.json").write_text("{}")
    export = tmp_path / "export"
    export.mkdir()
    (export / "export.json").write_text(
        '{"options": {"actions": "ee", "rotation": "6d", "pad": 1}}'
    )
    text = f"lerobot:{tmp_path}/act?like={export}"
    assert policy_name(text).label.endswith(",ee,6d,world")
    assert policy_name(f"{text}&frame=base").label.endswith(",ee,6d,base")
    assert "," not in policy_name(f"lerobot:{tmp_path}/act").label
    for wrong in (f"{text}x", f"{text}&rotation=euler"):
        with pytest.raises(PolicyError):
            policy_name(wrong)
