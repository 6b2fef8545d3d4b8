"""What `domino-data embodiments` says about every robot."""

from pipeline.data.names import SIDES
from pipeline.intake.catalogue.listings import list_robots
from pipeline.world.cameras import cameras_of
from pipeline.world.robots import MODELS, get_embodiment


def test_every_robot_is_described_in_full():
    listed = {e["name"]: e for e in list_robots()}
    assert list(listed) == list(MODELS)
    for name, e in listed.items():
        robot = get_embodiment(name)
        assert e["joints"] == list(robot.vector_names) and e["dof"] == len(robot.vector_names)
        assert set(e["limits"]) == {n for n in robot.vector_names if not n.endswith("_gripper")}
        assert all(lower < upper for lower, upper in e["limits"].values())
        assert e["cameras"] == [c.name for c in cameras_of(robot)]
        assert set(e["max_opening"]) == set(SIDES)
