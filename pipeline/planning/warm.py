"""Compile the numba kernels into the cache on disk, before several workers would all do it."""

import numpy as np

from pipeline.planning.collision_pieces import Sweep
from pipeline.planning.path import connect
from pipeline.planning.planner import ArmPlanner, Planner, planner_for
from pipeline.planning.scene import ArmState, Obstacle, PlanningScene
from pipeline.planning.trajectory import time_parameterise
from pipeline.poses import IDENTITY, pose
from pipeline.world.physics.body import TABLE_COLLISION


def warm_up(embodiment: str) -> None:
    """Call every kernel the expert uses: about 11 s of compilation the first time."""
    planner = planner_for(embodiment)
    arm = ArmPlanner(
        planner, planner.embodiment.sides[0], home_scene(planner), np.random.default_rng(0)
    )
    near = arm.home + 0.05
    tcp = arm.fk(near)
    arm.solve(tcp[None])
    arm.line(near, tcp + np.array([0, 0, 0.02, 0, 0, 0, 0]))
    arm.checker()(near)
    connect(lambda q: True, arm.home, near, arm.rng, (arm.chain.lower, arm.chain.upper))
    for count in (2, 5):
        time_parameterise(
            np.linspace(arm.home, near, count) ** 3, np.ones(arm.chain.dof), np.ones(arm.chain.dof)
        )
    Sweep([(0, TABLE_COLLISION)], IDENTITY[None, None], [TABLE_COLLISION], 0.0).first_contact(
        IDENTITY[None]
    )


def home_scene(planner: Planner) -> PlanningScene:
    """The arms at home with open jaws, and a body far away."""
    arms = {
        side: ArmState(planner.home(side), 1.0, planner.home(side))
        for side in planner.embodiment.sides
    }
    return PlanningScene(arms, {"post": Obstacle((TABLE_COLLISION,), pose((0.0, 0.0, -9.0)))}, {})
