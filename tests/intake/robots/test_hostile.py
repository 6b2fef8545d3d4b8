"""URDFs and meshes that no robot can be made of: one line, nothing written."""

import os

import numpy as np
import pytest

from pipeline.data.errors import DominoError
from pipeline.intake.robots.add import RobotOptions, draft_robot
from pipeline.world.meshes import files
from pipeline.world.robots import urdf_file
from tests.intake.objects.meshes import gltf
from tests.intake.objects.test_add import AWAY, MANY, NODES
from tests.intake.robots.tiny import HINGE, Tiny
from tests.run.command import inside

MESH = Tiny(mesh="package://vendor/part.stl")
BOMB = '<!DOCTYPE robot [<!ENTITY a "b"><!ENTITY b "&a;&a;&a;">]><robot '
THIRD = (
    '<joint name="jaw_c" type="prismatic"><parent link="hand"/><child link="finger_c"/><limit'
    ' lower="0" upper="1"/></joint>'
)


def refused(tmp_path, source, **options) -> str:
    """The line that `robots add` ends with; it writes nothing."""
    made = tmp_path / "made"
    with pytest.raises(DominoError) as error:
        draft_robot(source, RobotOptions("mine", made, **options))
    line = str(error.value)
    assert "\n" not in line and len(line) < 700 and not made.exists()
    return line


def test_the_command_prints_the_line(tmp_path):
    code, out, err = inside(
        "robots", "add", tmp_path / "gone.urdf", "--name", "mine", "--to", tmp_path / "made"
    )
    assert (
        (code, out, err.count("\n")) == (2, "", 1)
        and err.startswith("domino-data: ")
        and "gone.urdf: is neither" in err
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<robot ", BOMB, "declares a document type"),
        ("</robot>", "", "not readable as XML"),
        ("<robot ", '<?xml version="1.0" encoding="utf-99"?><robot ', "not readable as XML"),
        (
            "<robot ",
            (
                '<robot xmlns:xacro="http://ros.org/xacro"><xacro:include'
                ' filename="a"/></robot><robot '
            ),
            "not readable as XML",
        ),
        (
            "</robot>",
            '<xacro:include xmlns:xacro="http://ros.org/xacro" filename="a"/></robot>',
            "expand it first",
        ),
        ('xyz="0 0 0.3"', 'xyz="0 0 nan"', "<origin> has xyz='0 0 nan', not 3 finite numbers"),
        ('xyz="0 0 0.3"', 'xyz="0 0.3"', "<origin> has xyz='0 0.3', not 3 finite numbers"),
        ('mass value="0.8"', 'mass value="inf"', "<mass> has value='inf', not 1 finite number"),
        ('mass value="0.8"', 'mass value="heavy"', "<mass> has value='heavy'"),
        ('mass value="0.8"', 'mass value="0"', "link 'upper' has mass 0: give it one above 0"),
        ('mass value="0.8"', 'mass value="-1"', "link 'upper' has mass -1: give it one above 0"),
        (
            "</robot>",
            '<material name="m"><color rgba="red"/></material></robot>',
            "<color> has rgba='red', not 3 or 4",
        ),
        ('size="0.05 0.05 0.22"', 'size="0.05 0.05"', "not 3 finite numbers"),
        ('<box size="0.05 0.05 0.22"/>', "<torus/>", "<torus> is no mesh, box, cylinder or sphere"),
        (
            '<box size="0.05 0.05 0.22"/>',
            '<box size="0.05 -1 0.22"/>',
            "<box> is no mesh, box, cylinder or sphere with a size",
        ),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "joint 'j1' has an axis of length 0"),
        (
            '<child link="upper"/>',
            '<child link="uper"/>',
            "joint 'j2' names link 'uper', which the file does not have",
        ),
        (
            '<child link="upper"/>',
            '<child link="lower"/>',
            "joints 'j3' and 'j2' both move link 'lower'",
        ),
        ('<child link="upper"/>', "", "joint 'j2' needs a parent, a child and a type"),
        ('<parent link="turret"/>', '<parent link="wrist"/>', "hangs in a ring of joints"),
        (
            "</robot>",
            (
                '<joint name="r" type="fixed"><parent link="hand"/><child'
                ' link="base"/></joint></robot>'
            ),
            "form a ring",
        ),
        ("</robot>", '<link name="lost"/></robot>', "links 'base', 'lost' hang on no joint"),
        (
            "</robot>",
            f'<link name="finger_c"/>{THIRD}</robot>',
            "joints of the hand move by themselves: couple jaw_a, jaw_b, jaw_c",
        ),
        ('type="revolute"', 'type="fixed"', "no joint moves between 'base' and the gripper"),
        ('type="prismatic"', 'type="fixed"', "has no gripper"),
        (
            'lower="0" upper="0.03"',
            'lower="0" upper="0"',
            "joint 'jaw_a' of the gripper needs limits lower < upper",
        ),
        (
            'lower="-2.6" upper="2.6"',
            'lower="0" upper="0"',
            "joint 'j3' has limits 0 to 0: give it lower < upper",
        ),
        (
            '<joint name="j1" type="revolute"',
            '<joint name="j1" type="floating"',
            "joint 'j1' is floating: make it fixed",
        ),
        (
            '<joint name="j1" type="revolute"',
            '<joint name="j1" type="planar"',
            "give --base turret",
        ),
        (
            '<joint name="j1" type="revolute"',
            '<joint name="j1" type="ball"',
            "a type of revolute, prismatic, fixed, continuous",
        ),
        ('name="j2"', 'name=""', "give it a short name"),
        ('name="j2"', 'name="j1"', "two joints are named 'j1': give each its own name"),
        (
            'link name="upper"',
            'link name="lower"',
            "two links are named 'lower': give each its own name",
        ),
        ('"upper"', '"../../../upper"', "give it a short name without slashes"),
    ],
)
def test_a_urdf_that_is_no_robot_is_one_line(tmp_path, old, new, words):
    path = Tiny().write(tmp_path / "vendor")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert words in refused(tmp_path, path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("/etc/hostname", "is an absolute path"),
        ("C:\\part.stl", "is an absolute path"),
        ("file:///etc/hostname", "is a URL"),
        ("https://example.org/part.stl", "is a URL"),
        ("../../../../out.stl", "is outside of"),
        ("package://vendor/../../part.stl", "is outside of"),
        ("package://../part.stl", "is of the package '..', which is not here"),
        (
            "package://tool/part.stl",
            "is of the package 'tool', which is not here: give --package tool=DIR",
        ),
        ("package://", "is of the package ''"),
        ("", "is no name of a file"),
        ("a/" * 300 + "part.stl", "is no name of a file"),
        ("gone.stl", "was not found in"),
        ("meshes", "is no regular file"),
        ("pipe.stl", "is no regular file"),
        ("zero.stl", "is outside of"),
        ("part.stl", "is outside of"),
        ("meshes/two%20words.stl", "was not found in"),
        ("meshes\\two words.stl", "was not found in"),
        ("meshes/Two Words.STL", "was not found in"),
    ],
)
def test_a_mesh_that_is_not_there_is_refused_with_the_cause(tmp_path, name, words):
    path = Tiny(mesh=name).write(tmp_path / "up" / "vendor")
    (path.parent / "meshes").mkdir()
    (path.parent / "meshes" / "two words.stl").write_bytes(b"")
    (tmp_path / "out.stl").write_bytes(b"elsewhere")
    (path.parent / "part.stl").symlink_to(tmp_path / "out.stl")
    (path.parent / "zero.stl").symlink_to("/dev/zero")
    os.mkfifo(path.parent / "pipe.stl")
    said = refused(tmp_path, path.parent)
    assert "tiny.urdf: mesh " in said and words in said


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("part.stl", b"solid \xff\xfe", "part.stl: "),
        ("part.stl", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        ("part.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "part.obj: "),
        ("part.obj", b"v 0 0 0\nv 1000 0 0\nv 0 1 0\nf 1 2 3\n", "mind its scale"),
        ("part.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "have no area"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "is flat; give it a thickness"),
        ("part.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff", "part.glb: not readable"),
        ("part.zip", b"PK", "part.zip: not one of .glb"),
    ],
)
def test_a_damaged_mesh_is_one_line(tmp_path, name, data, words):
    path = Tiny(mesh=name).write(tmp_path / "vendor")
    (path.parent / name).write_bytes(data)
    assert words in refused(tmp_path, path)


@pytest.mark.parametrize("changes", [NODES, MANY, AWAY])
def test_a_hostile_glb_is_one_line(tmp_path, changes):
    path = Tiny(mesh="part.glb").write(tmp_path / "vendor")
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    gltf(path.parent / "part.glb", **changes)
    assert "part.glb: " in refused(tmp_path, path)


def test_a_mesh_of_too_many_triangles_is_refused(tmp_path):
    path, count = MESH.write(tmp_path / "vendor"), files.MAX_TRIANGLES + 1
    with open(path.parent / "part.stl", "wb") as file:
        file.write(bytes(80) + np.uint32(count).tobytes())
        file.truncate(84 + 50 * count)
    assert f"has {count} triangles in 1 materials; {count - 1} in" in refused(tmp_path, path)


def test_files_and_robots_have_a_largest_size(tmp_path, monkeypatch):
    path = MESH.write(tmp_path / "vendor")
    (path.parent / "part.stl").write_bytes(b"123")
    for limit, words in (("MAX_LINKS", "has 8 links"), ("MAX_URDF_BYTES", "it may have 1")):
        with monkeypatch.context() as patch:
            patch.setattr(urdf_file, limit, 1)
            assert words in refused(tmp_path, path)
    monkeypatch.setattr(files, "MAX_BYTES", len(path.read_bytes()) - 1)
    assert "a file has at most" in refused(tmp_path, path)


def test_what_is_not_there_is_named(tmp_path):
    path = Tiny(HINGE).write(tmp_path / "vendor")
    assert "neither a URDF, nor an MJCF, nor a directory" in refused(
        tmp_path, tmp_path / "gone.urdf"
    )
    assert "gone.xml: is neither" in refused(tmp_path, path, gripper=tmp_path / "gone.xml")
    assert "has no link 'pelvis'; links are base" in refused(tmp_path, path, base="pelvis")
    (path.parent / "second.urdf").write_text(path.read_text())
    assert "expected one .urdf, found second.urdf, tiny.urdf" in refused(
        tmp_path, tmp_path / "vendor"
    )
