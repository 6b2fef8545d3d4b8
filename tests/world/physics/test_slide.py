"""Bodies that belong to another: a drawer on its slide, balls that ride in a moving bin."""

import numpy as np

from pipeline.motion.planar import PlanarMotion
from pipeline.poses import compose, inverse, quat_rotate, yawed
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.simulation import PHYSICS_HZ, Simulation
from pipeline.world.robots import get_embodiment


def drawn(family, seed=0):
    return FAMILIES[family].draw(np.random.default_rng(seed))


def run(simulation, steps, push=None):
    for _ in range(steps):
        if push is not None:
            push()
        simulation.step(simulation.command, np.zeros(len(simulation.command)))


def test_a_drawer_runs_out_of_its_cabinet_and_nowhere_else():
    cabinet = drawn("cabinet")
    shell = Body("cabinet", "cabinet", cabinet, yawed((0, 0.2, TABLE_TOP), 0.3), fixed=True)
    closed = compose(shell.pose, cabinet.slot())
    drawer = Body(
        "drawer", "drawer", cabinet.drawer(), closed, inside="cabinet", slide=cabinet.slide()
    )
    can = Body("can", "can", drawn("can"), yawed((0.3, -0.2, TABLE_TOP), 0.0))
    s = Simulation(
        get_embodiment("aloha-agilex"),
        (shell, drawer, can),
        "can",
        PlanarMotion.still(can.pose, 1.0),
    )
    assert s.settle()
    out = quat_rotate(shell.pose[3:], np.array([0.0, -1.0, 0.0]))
    force, damping, mass = 6.0, 60.0, cabinet.drawer().shape().mass
    run(
        s,
        PHYSICS_HZ // 2,
        lambda: s._rigid["drawer"].add_force_at_point(force * out, s.pose("drawer")[:3]),
    )
    t = 0.5
    # m x'' = F - d x'
    expected = force / damping * (t - mass / damping * (1 - np.exp(-damping * t / mass)))
    moved = compose(inverse(closed), s.pose("drawer"))
    np.testing.assert_allclose(moved[:3], [0, -expected, 0], atol=0.004)
    np.testing.assert_allclose(np.abs(moved[3:]), [1, 0, 0, 0], atol=0.01)
    run(
        s,
        2 * PHYSICS_HZ,
        lambda: s._rigid["drawer"].add_force_at_point(3 * force * out, s.pose("drawer")[:3]),
    )
    assert abs(-compose(inverse(closed), s.pose("drawer"))[1] - cabinet.slide().upper) < 0.01


def test_balls_ride_in_a_moving_bin_without_meeting_it():
    bin_ = Body("bin", "table_bin", drawn("table_bin"), yawed((0.1, -0.1, TABLE_TOP), 0.4))
    at = [compose(bin_.pose, yawed((x, 0.0, 0.005), 0.0)) for x in (-0.02, 0.02)]
    balls = [Body(f"ball_{i}", "ball", drawn("ball", i), p, inside="bin") for i, p in enumerate(at)]
    start = bin_.pose + np.array([-0.1, 0, 0, 0, 0, 0, 0])

    class Straight:
        def pose(self, t):
            t = np.asarray(t, float)
            return start + t[..., None] * np.array([0.1, 0, 0, 0, 0, 0, 0])

        def twist(self, t):
            return np.broadcast_to([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], (*np.shape(t), 6))

        def scenery(self):
            return ()

    s = Simulation(get_embodiment("aloha-agilex"), (bin_, *balls), "bin", Straight())
    assert s.settle()
    run(s, PHYSICS_HZ)
    assert not s.released
    np.testing.assert_allclose(s.pose("bin")[:3], bin_.pose[:3], atol=1e-3)
    for ball in balls:
        local = compose(inverse(s.pose("bin")), s.pose(ball.name))[:3]
        assert np.hypot(local[0], local[1]) < bin_.instance.radius and 0 < local[2] < 0.02
