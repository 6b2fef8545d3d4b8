"""Policies that misbehave: each ends its own episode, is counted and shown, and the next is
played."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.evaluate import asking
from pipeline.evaluate.asking import AskedPolicy
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.policies.policy import Observation, PolicyName
from pipeline.evaluate.scenes.trial import INVALID_ACTION, NO_ANSWER
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.summary import summarise
from tests.evaluate.environment.test_env import case_of


@pytest.fixture
def named(monkeypatch):
    """A function that names a policy of this process."""
    policies = {}
    monkeypatch.setattr(asking, "make_policy", lambda name: policies[name.text])
    asking._load.cache_clear()

    def name(policy):
        policies[str(len(policies))] = policy
        return PolicyName(str(len(policies) - 1), "x", process="evaluator")

    yield name
    asking._load.cache_clear()


def answering(act):
    return SimpleNamespace(reset=lambda start: None, act=act)


LENGTH = 14
MISBEHAVIOUR = {
    "NaN": (lambda o: np.full(LENGTH, np.nan), INVALID_ACTION, "is not finite at index 0"),
    "inf": (lambda o: np.full((4, LENGTH), -np.inf), INVALID_ACTION, "is not finite at index 0"),
    "wrong shape": (lambda o: np.zeros(3), INVALID_ACTION, "shape (3,)"),
    "giant": (
        lambda o: np.zeros((100_000, LENGTH), np.float32),
        INVALID_ACTION,
        "shape (100000, 14)",
    ),
    "complex": (lambda o: np.zeros(LENGTH, complex), INVALID_ACTION, "type complex128"),
    "texts": (lambda o: ["1.0"] * LENGTH, INVALID_ACTION, "type <U3"),
    "objects": (lambda o: [None] * LENGTH, INVALID_ACTION, "type object"),
    "ragged": (lambda o: [[1.0], [1.0, 2.0]], INVALID_ACTION, "is no array: ValueError"),
    "exception": (lambda o: {}["left\n\x1b[2Jarm"], NO_ANSWER, "KeyError: 'left"),
    "exit": (lambda o: sys.exit(0), NO_ANSWER, "the process ended by itself: exit code 0"),
    "nothing": (lambda o: None, INVALID_ACTION, "type object"),
}


@pytest.mark.parametrize("name", MISBEHAVIOUR)
def test_each_misbehaviour_is_a_counted_episode(named, name):
    act, ending, said = MISBEHAVIOUR[name]
    row = run_episode(
        EpisodeJob(case_of("click_bell", 1), named(answering(act)), parse_clock("sim"))
    )
    assert (row["ending"], row["failure"], row["success"]) == (ending, ending, False)
    assert said in row["fault"] and row["fault"].isprintable()
    assert row["manipulation_score"] == row["route_completion"] == 0
    (cell,) = summarise([row])
    assert cell["episodes"] == cell["failures"][ending] == 1


def test_faults_after_a_good_start_gain_nothing(named):
    late = answering(lambda o: o.joints if o.time < 0.5 else np.full(LENGTH, np.nan))
    row = run_episode(EpisodeJob(case_of("click_bell", 1), named(late), parse_clock("sim")))
    assert row["asked"] == row["periods"] == 8 and row["manipulation_score"] == 0
    assert row["ending"] == INVALID_ACTION


EVERY = [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("counting", "charged"),
    [
        (lambda asked: asked // 3, [1, 1, 1, 2, 2, 2, 3]),
        (lambda asked: 7, [1] * 7),
        (lambda asked: -5, EVERY),
        (lambda asked: np.nan, EVERY),
        (lambda asked: "none", EVERY),
        (lambda asked: True, EVERY),
        (lambda asked: 100 - asked, EVERY),
        (lambda asked: None, EVERY),
    ],
)
def test_latency_is_charged_for_the_inferences_that_a_policy_counts(named, counting, charged):
    """An episode has one inference at least, however a policy counts; a count that is no number of
    runs counts nothing."""

    class Counts:
        asked = 3

        def act(self, observation):
            self.inferences = counting(self.asked)
            self.asked += 1
            return np.zeros(2)

    asked, counts = AskedPolicy(named(Counts())), []
    for _ in charged:
        asked.answer(Observation(np.zeros(2), "press", 0.0), 2)
        counts.append(asked.inferences)
    assert counts == charged and asked.count == 7


def test_all_answers_of_an_episode_have_a_limit_together(named, monkeypatch):
    """What a policy of another process may still take is what is left."""
    clock = iter(range(0, 1000, 3))
    monkeypatch.setattr(asking, "time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    limits, policy = [], answering(lambda o: limits.append(policy.seconds) or np.zeros(2))
    name = named(policy)
    asked = AskedPolicy(PolicyName(name.text, "x", process="own"), 1.0)
    for _ in range(4):
        asked.answer(Observation(np.zeros(2), "press", 0.0), 2)
    assert limits == [1.0, 1.0, 1.0, 0.999 + 0.001]
    asked.answer(Observation(np.zeros(2), "press", 0.0), 2)
    assert limits[-1] == 0.001


def test_an_error_that_cannot_be_printed_is_named():
    class Odd(Exception):
        def __str__(self):
            raise ValueError

    assert line_of(Odd()) == "Odd:"
    assert line_of(ValueError("\x1b[31mred\n" + "x" * 9000)).startswith(
        "ValueError: \\x1b[31mred x"
    )
