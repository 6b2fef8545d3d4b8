"""Compile the numba kernels once, before several workers would."""

import numpy as np

from pipeline.poses import IDENTITY, pose
from pipeline.world.physics.body import TABLE_COLLISION

from .collision import ArmState, Obstacle, PlanningScene
from .collision_pieces import Sweep
from .path import connect
from .planner import ArmPlanner, Planner, planner_for
from .trajectory import time_parameterise


def warm_up(embodiment: str) -> None:
    """Call every kernel: about 11 s of compilation the first time."""
    planner = planner_for(embodiment)
    side, rng = planner.embodiment.sides[0], np.random.default_rng(0)
    arm = ArmPlanner(planner, side, home_scene(planner), rng)
    near = arm.chain.home + 0.05
    tcp = arm.fk(near)
    arm.solve(tcp[None])
    arm.line(near, tcp + np.array([0, 0, 0.02, 0, 0, 0, 0]))
    arm.checker()(near)
    connect(lambda q: True, arm.chain.home, near, arm.rng, (arm.chain.lower, arm.chain.upper))
    ones = np.ones(len(arm.chain.home))
    for count in (2, 5):
        time_parameterise(np.linspace(arm.chain.home, near, count) ** 3, ones, ones)
    sweep = Sweep([(0, TABLE_COLLISION)], IDENTITY[None, None], [TABLE_COLLISION], 0.0)
    sweep.first_contact(IDENTITY[None])


def home_scene(planner: Planner) -> PlanningScene:
    homes = ((side, planner.home(side)) for side in planner.embodiment.sides)
    arms = {side: ArmState(q, 1.0, q) for side, q in homes}
    return PlanningScene(arms, {"post": Obstacle((TABLE_COLLISION,), pose((0.0, 0.0, -9.0)))}, {})
