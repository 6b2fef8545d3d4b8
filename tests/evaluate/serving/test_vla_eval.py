"""The benchmark for vla-eval, driven as its runner does: by a stand-in of the StepBenchmark that it
publishes (0.8.0)."""

import importlib
import sys
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

from pipeline.data.recipe.model import Cell
from pipeline.evaluate.scenes.benchmark import frozen_scenes
from pipeline.evaluate.scenes.case import BLIND, expert_actions


@dataclass
class StepResult:
    obs: object
    reward: float
    done: bool
    info: dict


class StepBenchmark:
    def __init__(self):
        self._last_result = StepResult(None, 0.0, False, {})


@dataclass(frozen=True)
class DimSpec:
    name: str
    dims: int
    format: str
    description: str = ""


@pytest.fixture
def benchmark(monkeypatch):
    """The class, with vla-eval's modules replaced by what it uses of them."""
    modules = {
        name: ModuleType(name)
        for name in (
            "vla_eval",
            "vla_eval.benchmarks",
            "vla_eval.benchmarks.base",
            "vla_eval.specs",
        )
    }
    vars(modules["vla_eval.benchmarks.base"]).update(
        StepBenchmark=StepBenchmark, StepResult=StepResult
    )
    specs = {
        "IMAGE_RGB": DimSpec("image", 0, "rgb"),
        "LANGUAGE": DimSpec("language", 0, "language"),
        "DimSpec": DimSpec,
    }
    vars(modules["vla_eval.specs"]).update(specs)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    name = "pipeline.evaluate.serving.vla_eval"
    monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module(name).DominoBenchmark
    sys.modules.pop(name, None)


def test_recorded_actions_succeed_there_too(benchmark):
    b = benchmark(["click_bell"], setup=BLIND)
    # as its orchestrator does: a task for each name, the episodes counted by the harness
    tasks = [{**task, "episode_idx": i} for task in b.get_tasks() for i in range(2)]
    assert [(t["name"], t["episode_idx"]) for t in tasks] == [("click_bell", i) for i in (0, 1)]
    assert not any("seed" in t for t in tasks)
    b._last_result = StepResult(b.reset(tasks[1]), 0.0, False, {})
    assert (b.get_hold_action(None)["actions"] == b._last_result.obs["agent_pos"]).all()
    actions, steps = expert_actions(b._env.case), 0
    while not b._last_result.done:
        assert steps < b.get_metadata()["max_steps"]
        b._last_result = b.step({"actions": actions[min(steps, len(actions) - 1)][None]})
        steps += 1
    seen = b.make_obs(b._last_result.obs, tasks[1])
    assert set(seen) == {"images", "task_description", "state"}
    assert seen["state"].shape == (14,)
    assert seen["task_description"]
    assert b.get_step_result(b._last_result) == {
        "success": True,
        "route_completion": 100.0,
        "manipulation_score": 100.0,
    }
    assert set(b.get_metric_keys()) == set(b.get_step_result(b._last_result))
    assert b.get_action_spec()["joints"].dims == 14
    hold = {"actions": np.zeros(14)}
    assert b.get_hold_action(hold) is hold
    b.cleanup()


def test_episodes_are_the_frozen_scenes_of_a_benchmark(benchmark):
    b = benchmark(["click_bell"], setup=BLIND, benchmark="domino-v1")
    frozen = frozen_scenes("domino-v1", Cell("click_bell", "aloha-agilex", 1, 0.1, "clean"))
    for number in (2, 52):
        b.reset({**b.get_tasks()[0], "episode_idx": number})
        assert b._env.case is frozen[2]
    b.cleanup()


def test_a_task_that_does_not_exist_is_named(benchmark):
    with pytest.raises(KeyError, match="juggle"):
        benchmark(["juggle"])
