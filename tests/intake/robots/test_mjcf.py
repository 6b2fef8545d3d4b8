"""`robots add` of MJCF files and of grippers in files of their own, against MuJoCo's own
kinematics."""

import sys

import numpy as np
import pytest
import trimesh

from pipeline.data.errors import DominoError
from pipeline.intake.robots.add import mount
from pipeline.intake.robots.anatomy import anatomy
from pipeline.intake.robots.mjcf import read_mjcf
from pipeline.poses import quat_from_matrix
from pipeline.world.robots.urdf_file import UrdfError, read_urdf
from tests.intake.robots.test_hostile import refused
from tests.intake.robots.tiny import SLIDES, Tiny

mujoco = pytest.importorskip("mujoco")

HEAD = '<compiler angle="radian"/><asset><material name="red" rgba="1 0 0 1"/></asset>'
ARM = (
    f'<mujoco>{HEAD}<worldbody><geom type="plane" size="1 1 0.1"/><body name="base" pos="0.4 0 1"'
    ' quat="0 0 0 1"><geom type="box" size="0.05 0.05 0.03" material="red" contype="0"'
    ' conaffinity="0"/><geom type="sphere" size="0.04"/><body name="upper" pos="0 0 0.1" quat="0.9'
    ' 0.1 0.3 0.2"><joint name="j1" pos="0.02 0 -0.03" axis="0 1 1" range="-2 2"/><inertial'
    ' pos="0.01 0 0.1" mass="1.5" quat="0.8 0.6 0 0" diaginertia="0.01 0.02 0.025"/><geom'
    ' type="capsule" size="0.03 0.1" pos="0 0 0.1"/><body name="lower" pos="0 0 0.25"><joint'
    ' name="j2" axis="1 0 0" range="-1.5 2.5"/><geom type="cylinder" size="0.02 0.08"/><body'
    ' name="wrist" pos="0 0 0.2"><joint name="j3" axis="0 0 1" pos="0 0.01 0"/><geom type="box"'
    ' size="0.02 0.02 0.02"/>END</body></body></body></body></worldbody><actuator><motor'
    ' joint="j1" ctrlrange="-30 30" gear="2"/><position joint="j2" kp="9" forcerange="-7'
    ' 7"/></actuator></mujoco>'
)
FLANGE = '<body name="flange" pos="0 0 0.05"/>'
_SIDE = (
    '<body name="{s}" pos="0 {y} 0.05"><joint name="drive_{s}" axis="{x} 0 0" range="0 0.5"/><geom'
    ' type="sphere" size="0.005"/><body name="tip_{s}" pos="0 0 0.05"><joint name="pivot_{s}"'
    ' axis="{x} 0 0"/><geom type="box" size="0.01 0.005 0.03" pos="0 0 0.03"/></body></body><body'
    ' name="link_{s}" pos="0 {z} 0.05"><joint name="link_{s}" axis="{x} 0 0"/><geom type="box"'
    ' size=".004 .004 .004"/></body>'
)
_PALM = '<body name="palm"><geom type="box" size="0.02 0.05 0.02"/>'
LINKAGE = (
    f"<mujoco>{HEAD}<worldbody>{_PALM}{_SIDE.format(s='a', y=0.02, z=0.04, x=-1)}{_SIDE.format(s='b', y=-0.02, z=-0.04, x=1)}</body></worldbody><equality><joint"  # noqa: E501
    ' joint1="drive_b" joint2="drive_a"/><connect body1="tip_a" body2="link_a" anchor="0'
    ' 0.02 0"/><connect body1="tip_b" body2="link_b" anchor="0 -0.02'
    ' 0"/></equality><actuator><position joint="drive_a" kp="1"/></actuator></mujoco>'
)
"""Two parallelograms that loops close: the fingers stay parallel, so that `pivot` turns by as much
as `drive`, backwards."""


def put(folder, text, name="arm.xml"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def read(folder, text, name="arm.xml"):
    scratch = folder / f"scratch-{name}"
    scratch.mkdir(parents=True)
    return read_mjcf(put(folder, text, name), scratch)


def test_links_are_where_mujoco_has_them(tmp_path):
    robot = read(tmp_path, ARM.replace("END", FLANGE))
    model = mujoco.MjModel.from_xml_string(ARM.replace("END", FLANGE))
    data = mujoco.MjData(model)
    data.qpos[:] = q = [0.7, -1.1, 0.4]
    mujoco.mj_kinematics(model, data)
    placed = robot.link_poses("base", dict(zip(("upper", "lower", "wrist"), q, strict=True)))
    root = data.body("base").xmat.reshape(3, 3)
    for name in ("upper", "lower", "wrist"):
        anchor = data.xanchor[model.body(name).jntadr[0]]
        np.testing.assert_allclose(
            placed[name][:3], root.T @ (anchor - data.body("base").xpos), atol=1e-12
        )
    turned = quat_from_matrix(root.T @ data.body("flange").xmat.reshape(3, 3))
    np.testing.assert_allclose(abs(placed["flange"][3:] @ turned), 1, atol=1e-12)
    # where the mass is does not depend on the frame of the link
    upper = robot.links["upper"]
    com = data.body("upper").xipos - data.xanchor[0]
    np.testing.assert_allclose(np.linalg.norm(upper.com), np.linalg.norm(com), atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(upper.inertia), [0.01, 0.02, 0.025], atol=1e-12)
    joints = {joint.name: joint for joint in robot.parent_joint.values()}
    assert (joints["j1"].effort, joints["j2"].effort, joints["j1"].lower, joints["j2"].upper) == (
        60,
        7,
        -2,
        2.5,
    )
    (look,), (solid,) = robot.links["base"].visuals, robot.links["base"].collisions
    corners = trimesh.load_mesh(solid.file).vertices
    assert look.color == (1, 0, 0)
    assert np.ptp(corners, axis=0) == pytest.approx([0.08] * 3, abs=1e-3)


def test_what_loops_and_equalities_couple_becomes_mimic_rules(tmp_path):
    robot = read(tmp_path, LINKAGE)
    expected = {"drive_b": 1, "pivot_a": -1, "pivot_b": -1, "link_a": 1, "link_b": 1}
    assert {rule.joint for rule in robot.mimics.values()} == {"drive_a"}
    assert {name: rule.multiplier for name, rule in robot.mimics.items()} == pytest.approx(
        expected, abs=0.02
    )
    assert max(abs(rule.offset) for rule in robot.mimics.values()) < 0.01


@pytest.mark.parametrize(
    "flange",
    [FLANGE, '<site name="attachment_site" pos="0 0 0.05"/><body name="x"/><body name="y"/>'],
)
def test_an_arm_takes_a_gripper_of_another_file(tmp_path, flange):
    arm, gripper = (
        read(tmp_path, ARM.replace("END", flange)),
        read(tmp_path, LINKAGE, "gripper.xml"),
    )
    found = anatomy(mount(arm, gripper, None))
    assert found.arm_joints == ("j1", "j2", "j3") and found.hand == "gripper_palm"
    assert set(found.fingers) == {"gripper_tip_a", "gripper_tip_b"}
    assert found.opening == pytest.approx(2 * (0.02 + 0.05 * np.sin(0.5) - 0.005), abs=2e-3)
    both = mount(
        read_urdf(Tiny(SLIDES.replace("prismatic", "fixed")).write(tmp_path)), gripper, "hand"
    )
    assert anatomy(both).arm_joints == ("j1", "j2", "j3", "j4", "j5")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<mujoco>", "<!DOCTYPE m><mujoco>", "declares a document type"),
        ("mujoco>", "robot>", "is no MJCF: it begins with <robot>"),
        (
            "<actuator>",
            '<include file="../../../out.xml"/><actuator>',
            "names '../../../out.xml', which is outside of",
        ),
        (
            "<actuator>",
            '<include file="/etc/hostname"/><actuator>',
            "names '/etc/hostname', which is outside of",
        ),
        (
            "<actuator>",
            '<include file="arm.xml"/><actuator>',
            "includes 'arm.xml' twice or in a ring",
        ),
        (
            "<asset>",
            '<asset><mesh file="C:/part.stl"/>',
            "names 'C:/part.stl', which is outside of",
        ),
        ("<asset>", '<asset><mesh file="part.stl"/>', "MuJoCo refuses it (Error"),
        ("<worldbody>", "<worldbody><torus/>", "unrecognized element"),
        ('axis="1 0 0"', 'axis="0 0 0"', "MuJoCo refuses it"),
        ('mass="1.5"', 'mass="nan"', "MuJoCo refuses it"),
        ("<joint ", '<joint type="slide"/><joint ', "must have one joint, a hinge or a slide"),
        (
            "<worldbody>",
            '<worldbody><body name="b"><joint/><geom size="1"/></body>',
            "links 'b', 'base' hang on no joint",
        ),
        (
            "END",
            FLANGE + '<body name="cam"/>',
            "found flange, cam to carry the gripper; give --flange LINK",
        ),
    ],
)
def test_an_mjcf_that_is_no_arm_is_one_line(tmp_path, monkeypatch, old, new, words):
    assert old in ARM
    monkeypatch.chdir(tmp_path)
    gripper = put(tmp_path, LINKAGE, "gripper.xml")
    path = put(tmp_path / "a" / "b" / "c", ARM.replace(old, new).replace("END", FLANGE))
    assert words in refused(tmp_path, path, gripper=gripper)
    assert not list(tmp_path.glob("MUJOCO_LOG*"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            LINKAGE.replace('range="0 0.5"', ""),
            "joint 'drive_a' drives other joints and has no limits",
        ),
        (
            LINKAGE.replace('joint2="drive_a"', 'joint2="drive_a" polycoef="0 0 2"'),
            "does not follow its driving joint in proportion",
        ),
        (
            LINKAGE.replace(
                "</worldbody>", '<body name="c"><joint/><geom size="1"/></body></worldbody>'
            ),
            "has 2 root links",
        ),
    ],
)
def test_a_gripper_that_cannot_be_used_is_one_line(tmp_path, text, words):
    gripper = put(tmp_path, text, "gripper.xml")
    refused(tmp_path, put(tmp_path, ARM.replace("END", FLANGE)), gripper=gripper)
    with pytest.raises(UrdfError, match=words):
        mount(read(tmp_path / "a", ARM.replace("END", FLANGE)), read(tmp_path / "g", text), None)


def test_a_flange_is_a_link_beyond_which_nothing_moves(tmp_path):
    arm, gripper = read_urdf(Tiny(SLIDES).write(tmp_path)), read(tmp_path, LINKAGE)
    with pytest.raises(UrdfError, match="joint 'jaw_a' moves beyond 'hand'"):
        mount(arm, gripper, "hand")
    with pytest.raises(UrdfError, match="--flange 'tool0': has no such link"):
        mount(arm, gripper, "tool0")


def test_without_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(DominoError, match=r"--extra mjcf"):
        read_mjcf(put(tmp_path, ARM), tmp_path)
