"""The drive of a touched target: what it follows, how hard it pulls, when it comes back, and what
ends it."""

import numpy as np
import pytest

from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import angle_between, yawed
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.drive import FORCE, HELD, Hold
from pipeline.world.physics.simulation import PHYSICS_HZ, Simulation
from pipeline.world.robots import get_embodiment

SPEED = 0.1


def body(name, family, x, y, fixed=False):
    return Body(
        name,
        family,
        FAMILIES[family].draw(np.random.default_rng(0)),
        yawed((x, y, TABLE_TOP), 0.0),
        fixed,
    )


def driven(grips=(), other=0.0):
    """A can that goes along x at SPEED and hits a block beside its way, `other` m off its line;
    both free."""
    target, block = body("target", "can", -0.2, 0.15), body("block", "block", -0.1, 0.15 + other)
    way = Segment(0.0, 4.0, np.array([[-0.2, SPEED * 4.0], [0.15, 0.0]]))
    motion = PlanarMotion(1, 0.1, 4.0, 0.0, TABLE_TOP, target.pose[3:], (way,))
    s = Simulation(
        get_embodiment("aloha-agilex"), (target, block), "target", motion, after_touch=Hold(grips)
    )
    assert s.settle()
    return s, motion


def run(s, seconds):
    still = np.zeros(len(s.command))
    for _ in range(round(seconds * PHYSICS_HZ)):
        s.step(s.home_vector(), still)


def test_a_touched_target_stays_on_its_motion_and_pushes_what_is_light():
    s, motion = driven()
    run(s, 2.0)
    assert s.touched_by == "block" and not s.released
    assert [event.name for event in s.events] == ["meeting"]
    assert np.linalg.norm(s.pose("target")[:3] - motion.pose(2.0)[:3]) < 0.004
    assert s.pose("target")[3:] == pytest.approx(motion.pose(2.0)[3:], abs=0.01)
    # the turn that the solver states while it holds a body against a push is not one it makes
    assert s.target_twist()[:3] == pytest.approx([SPEED, 0, 0], abs=0.02)
    assert s.pose("block")[0] > -0.05


def test_it_pulls_with_its_force_and_comes_back_when_let_go():
    s, motion = driven()
    run(s, 1.0)
    target = s._rigid["target"]
    # a hand that holds it back with less than FORCE loses, with more it wins
    for push, wins in ((0.7 * FORCE, False), (1.3 * FORCE, True)):
        before = s.pose("target")[0]
        for _ in range(60):
            target.add_force_torque(np.array([-push, 0, 0], np.float32), np.zeros(3, np.float32))
            run(s, 1 / PHYSICS_HZ)
        assert (s.pose("target")[0] < before) == wins
    away = np.linalg.norm(s.pose("target")[:3] - motion.pose(s.time)[:3])
    run(s, 1.5)
    back = np.linalg.norm(s.pose("target")[:3] - motion.pose(s.time)[:3])
    assert away > 0.03 and back < 0.004
    assert angle_between(s.pose("target")[3:], motion.pose(s.time)[3:]) < 0.05


def test_what_holds_it_long_enough_ends_its_motion():
    s, _ = driven(((frozenset({"block"}),),))
    run(s, 2.0)
    meeting, release = s.events
    assert (meeting.name, release.name) == ("meeting", "release")
    assert release.time - meeting.time >= HELD - 1.5 / PHYSICS_HZ
    run(s, 1.0)
    assert s.speed("target") < 0.01
    assert s.pose("target")[2] == pytest.approx(TABLE_TOP, abs=0.005)


def test_every_part_of_a_grip_must_touch():
    hold = Hold(((frozenset({"a"}), frozenset({"b", "c"})), (frozenset({"d"}),)))
    assert hold.holds({"a", "c"}) and hold.holds({"d"})
    assert not hold.holds({"a"}) and not hold.holds({"b", "c"}) and not hold.holds(set())
