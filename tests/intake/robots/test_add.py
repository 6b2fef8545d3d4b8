"""`robots add`: what is found in a URDF, what is written, and that it comes back as the same
robot."""

import numpy as np
import pytest
import trimesh

from pipeline.intake.robots.add import RobotOptions, add_robot, check_name
from pipeline.intake.robots.anatomy import anatomy
from pipeline.intake.robots.simplify import CORNERS
from pipeline.planning.collision import CollisionWorld
from pipeline.poses import quat_rotate
from pipeline.world.robots import MODELS
from pipeline.world.robots.contract import RobotError, arm_poses, check_arm, jaw_positions
from pipeline.world.robots.directory import RobotModel
from pipeline.world.robots.pairs import pair
from pipeline.world.robots.urdf_file import read_urdf
from tests.intake.robots.tiny import COUPLED, HINGE, LINKAGE, SLIDES, Tiny


@pytest.mark.parametrize("name", sorted(MODELS))
def test_the_parts_of_our_robots_are_found_in_their_urdfs(name):
    directory, said = MODELS[name].directory, MODELS[name].settings
    found = anatomy(read_urdf(directory / "robot.urdf", directory))
    assert found.hand == said.hand and set(found.fingers) == set(said.gripper.fingers)
    assert found.arm_joints == MODELS[name].arm("left").arm_joints
    assert list(found.jaws) == list(said.gripper.joints)
    np.testing.assert_allclose(
        [end for _, end in found.jaws.values()], said.gripper.opened, atol=0.003
    )
    assert found.opening == pytest.approx(said.gripper.opening, abs=0.006)
    position, approach, opening = found.tcp
    np.testing.assert_allclose(position, said.tcp.position, atol=0.009)
    np.testing.assert_allclose(approach, said.tcp.approach)
    assert abs(opening @ said.tcp.opening) == pytest.approx(1)


@pytest.mark.parametrize("jaws, closing", [(SLIDES, (0.0, 0.0)), (COUPLED, (0.0, -0.0))])
def test_the_tool_frame_is_between_the_pads_of_two_slides(tmp_path, jaws, closing):
    found = anatomy(read_urdf(Tiny(jaws).write(tmp_path)))
    assert found.arm_joints == ("j1", "j2", "j3", "j4", "j5") and found.hand == "hand"
    assert tuple(a for a, _ in found.jaws.values()) == closing
    assert abs(found.jaws["jaw_b"][1]) == 0.03
    # fingers 10 mm thick whose middles are at 10 mm closed and 40 mm open, and whose tips are at
    # 140 mm
    assert found.opening == pytest.approx(2 * (0.04 - 0.005))
    np.testing.assert_allclose(found.tcp, [[0, 0, 0.14 - 0.018], [0, 0, 1], [0, 1, 0]], atol=1e-12)


def test_a_linkage_is_driven_by_every_joint_and_opens_as_far_as_it_swings(tmp_path):
    found = anatomy(read_urdf(Tiny(LINKAGE).write(tmp_path)))
    assert found.jaws == {
        "knuckle_a": (0.0, 0.5),
        "jaw_a": (0.0, -0.5),
        "knuckle_b": (0.0, 0.5),
        "jaw_b": (0.0, -0.5),
    }
    assert found.opening == pytest.approx(2 * (0.02 + 0.05 * np.sin(0.5) - 0.005))
    assert set(found.fingers) == {"finger_a", "finger_b"}


def test_a_hinged_jaw_meets_a_finger_that_stands_still(tmp_path):
    found = anatomy(read_urdf(Tiny(HINGE).write(tmp_path)))
    assert found.fingers == ("finger_a", "finger_b") and found.jaws == {"jaw_a": (0.0, 0.8)}
    # the pad's end, 60 mm from the hinge and 5 mm inside of it, swings out
    assert found.opening == pytest.approx(
        0.02 - 0.005 + 0.04 * np.sin(0.8) - 0.005 * np.cos(0.8), abs=0.012
    )


def test_what_is_written_is_read_again_as_a_sound_robot(tmp_path):
    (tmp_path / "meshes").mkdir()
    trimesh.creation.capsule(height=0.2, radius=0.03).export(tmp_path / "meshes" / "upper.stl")
    source = Tiny(LINKAGE, mesh="meshes/upper.stl").write(tmp_path)
    directory, _ = add_robot(source, RobotOptions("tiny", tmp_path / "mine", licence='BSD "3"'))
    assert directory == tmp_path / "mine" / "robots" / "tiny"
    model = RobotModel(directory)
    assert (
        model.settings.licence == "BSD 3"
        and len((directory / "robot.toml").read_text().splitlines()) < 45
    )
    for side, sign in (("left", -1), ("right", 1)):
        arm = model.arm(side)
        check_arm("tiny", side, arm)
        assert np.sign(arm.base[0]) == sign
        at = arm_poses(arm, arm.home, 1.0)
        # over its own side of the table, pointing down
        assert np.sign(at["hand"][0]) == sign and quat_rotate(at["hand"][3:], [0.0, 0, 1])[2] < -0.5
        assert arm.gripper.opening == pytest.approx(2 * (0.015 + 0.05 * np.sin(0.5)), abs=1e-4)
        opened = dict(zip(arm.gripper.joints, jaw_positions(arm.gripper, 1.0), strict=True))
        assert opened == {"knuckle_a": 0.5, "jaw_a": -0.5, "knuckle_b": 0.5, "jaw_b": -0.5}
    rest = (model.arm(side).home for side in ("left", "right"))
    assert CollisionWorld(pair(model, model)).with_objects(margin=0.0).first_blocked(*rest) is None
    links = {link.name: link for link in model.arm("left").links}
    assert links["upper"].mass == 0.8 and links["knuckle_a"].mass > 0
    (piece,) = links["upper"].collision
    assert piece.kind == "convex" and len(piece.vertices) <= CORNERS
    assert np.ptp(piece.vertices[:, 2]) == pytest.approx(0.26, abs=0.01) and links["upper"].visual
    assert (directory / "meshes" / "upper.glb").is_file()


def test_of_two_arms_in_a_file_the_one_that_is_named_is_taken(tmp_path):
    stand = (
        '<link name="stand"/><joint name="foot" type="fixed"><parent link="stand"/><child'
        ' link="base"/></joint>'
    )
    robot = read_urdf(Tiny(extra=stand).write(tmp_path))
    assert "stand" in anatomy(robot).links and "stand" not in anatomy(robot, "base").links


@pytest.mark.parametrize("name", ["piper", "ur5", "Mine", "my_arm", "../up", "none", ""])
def test_a_name_that_no_robot_can_have_is_refused(tmp_path, name):
    with pytest.raises(RobotError, match="--name"):
        check_name(name, tmp_path)


def test_a_directory_that_exists_is_kept(tmp_path):
    kept = tmp_path / "robots" / "tiny" / "robot.toml"
    kept.parent.mkdir(parents=True)
    kept.write_text("mine")
    with pytest.raises(RobotError, match="exists; remove it first"):
        check_name("tiny", kept.parent)
    assert kept.read_text() == "mine"
