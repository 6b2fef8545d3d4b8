"""Tool poses as actions of an environment whose robot does not stand at its usual place."""

from typing import Any

import gymnasium
import numpy as np

from pipeline.evaluate import env_id
from pipeline.evaluate.scenes.case import BLIND
from pipeline.world.robots import get_embodiment


def test_tool_poses_are_of_the_world_where_the_randomized_domain_raises_the_robot():
    env: Any = gymnasium.make(
        env_id("click_bell"), level=1, domain="randomized", actions="ee", setup=BLIND
    ).unwrapped
    env.reset(seed=4)
    simulation = env.trial.simulation
    robot = simulation.embodiment
    raised = robot.arms["left"].base[2] - get_embodiment("aloha").arms["left"].base[2]
    assert raised > 2e-3
    tools = np.stack([simulation.tcp(side) for side in robot.sides])
    env.step(np.concatenate([np.append(tool, 1.0) for tool in tools]).astype(np.float32))
    after = np.stack([simulation.tcp(side) for side in robot.sides])
    np.testing.assert_allclose(after[:, :3], tools[:, :3], atol=2e-4)
