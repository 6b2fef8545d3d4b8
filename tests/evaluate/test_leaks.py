"""What a policy is told, and whether it tells the scene: a policy that knows this program tries to
find its scene in it."""

import hashlib
import json
from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pipeline.data.atomic import write_atomic
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate import asking
from pipeline.evaluate.asking import load_once
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.evaluate import Evaluation, evaluate
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.manifests import Manifest, Manifests, first_seed, inline
from pipeline.evaluate.scenes.trial import instruction_of
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.stages.scene import build_scene
from tests.evaluate.environment.test_env import case_of

RECORDER = """
import numpy as np
TOLD = []
class Recorder:
    def reset(self, start): self.start = start
    def act(self, observation):
        TOLD.append((self.start, observation))
        return np.full(14, np.nan)
def make_policy():
    policy = Recorder()
    policy.told = TOLD
    return policy
"""


@pytest.fixture
def recorder(tmp_path):
    path = tmp_path / "recorder.py"
    path.write_text(RECORDER)
    asking._load.cache_clear()
    yield replace(policy_name(str(path)), process="evaluator")
    asking._load.cache_clear()


def still(seed):
    """A case of a seed whose target stands: the expert need not be run for what is told at the
    start."""
    solved = case_of("click_bell", 0)
    return Case(
        EpisodeSpec("click_bell", "aloha-agilex", 0, 0.1, "clean", 0, seed),
        solved.motion,
        1.0,
        30,
        "s",
        "e",
    )


def numbers_of(start, observation):
    """Every number that a policy without cameras is told."""
    return (start.seed, start.fps, observation.time, *observation.joints.tolist())


def test_no_number_that_a_policy_is_told_depends_on_the_scene(recorder):
    """The attacker knows the program, every seed that may have been admitted, and all that the
    policy is told."""
    seeds = range(first_seed(0), first_seed(0) + 12)
    for seed in seeds:
        run_episode(EpisodeJob(still(seed), recorder, parse_clock("sim")))
    told = load_once(recorder).told
    assert len(told) == len(seeds)
    by_sentence = {}
    for start, observation in told:
        by_sentence.setdefault(start.instruction, set()).add(numbers_of(start, observation))
        assert start.seed not in seeds
    assert all(len(numbers) == 1 for numbers in by_sentence.values())
    # the seed is a function of the sentence: whatever is tried on a scene's own seed does not give
    # it
    for (start, _), seed in product(told, seeds):
        for text in (
            str(seed),
            json.dumps(seed),
            EpisodeSpec("click_bell", "aloha-agilex", 0, 0.1, "clean", 0, seed).to_json(),
        ):
            assert (
                int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little") >> 1
                != start.seed
            )
    joints = np.array([observation.joints for _, observation in told])
    assert (joints == joints[0]).all()


def test_a_sentence_alone_fits_many_scenes_of_a_secret_seed():
    """With a --seed that its author does not know, a sentence that fits one scene in fifty fits
    20,000 of a million."""

    def sentence(seed):
        return instruction_of(
            build_scene(EpisodeSpec("click_bell", "aloha-agilex", 0, 0.1, "clean", 0, seed))
        )

    found = Counter(sentence(first_seed(0) + n) for n in range(60))
    assert max(found.values()) >= 2, (
        "sentences are drawn from a set that is small against the seeds"
    )


def test_episodes_of_a_cell_come_in_an_order_that_says_nothing(tmp_path, recorder, monkeypatch):
    cell = Cell("click_bell", "aloha-agilex", 0, 0.1, "clean")
    cases = [still(first_seed(0) + n) for n in range(8)]
    orders = []
    monkeypatch.setattr("pipeline.evaluate.evaluate._film", lambda *given: None)
    monkeypatch.setattr("pipeline.evaluate.evaluate._write_page", lambda *given: tmp_path)
    for n in range(3):
        manifests = Manifests(tmp_path / "manifests")
        write_atomic(
            manifests.path(cell), Manifest(cell, first_seed(0), tried=8, cases=cases).to_json()
        )
        wanted = Evaluation((cell,), recorder, parse_clock("sim"), 8)
        evaluate(wanted, tmp_path / str(n), inline, tmp_path / "manifests")
        lines = (tmp_path / str(n) / "episodes.jsonl").read_text().splitlines()
        orders.append([json.loads(line)["seed"] for line in lines])
    assert {tuple(sorted(order)) for order in orders} == {tuple(case.spec.seed for case in cases)}
    # one in 8! to be the same twice
    assert len({tuple(order) for order in orders}) > 1
