"""Masses of labels are those of the physics, and contact forces carry them."""

import numpy as np
import pytest

from pipeline.data.episode.world import contact_forces
from pipeline.motion.planar import PlanarMotion
from pipeline.poses import yawed
from pipeline.stages.drawing.truth import simulated_mass
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import PHYSICS_HZ, Simulation
from pipeline.world.robots import get_embodiment


def test_what_rests_on_the_table_presses_with_the_weight_of_its_labels():
    """A bell has a convex piece, whose stated volume is that of its box."""
    bodies = {
        name: Body(
            name,
            name,
            FAMILIES[name].draw(np.random.default_rng(0)),
            yawed((0.3 * i - 0.3, 0.25, TABLE_TOP), 0.0),
        )
        for i, name in enumerate(("can", "bell", "block"))
    }
    still = PlanarMotion.still(bodies["can"].pose, 1.0)
    simulation = Simulation(get_embodiment("aloha-agilex"), [*bodies.values()], "can", still)
    recorder = Recorder(simulation, 15)
    for _ in range(PHYSICS_HZ // 2):
        simulation.step(simulation.home_vector(), np.zeros(len(simulation.command)))
        recorder.after_step()
    log = recorder.log()
    forces = contact_forces(log, PHYSICS_HZ)
    for name in ("bell", "block"):
        rows = (log.contacts["frame"] == len(log) - 1) & (
            log.contacts["a"] == log.bodies.index(name)
        )
        weight = simulated_mass(bodies[name].instance.shape()) * 9.81
        assert forces[rows].sum() == pytest.approx(weight, rel=0.02)
    stated = bodies["bell"].instance.shape().mass
    assert simulated_mass(bodies["bell"].instance.shape()) < 0.8 * stated
