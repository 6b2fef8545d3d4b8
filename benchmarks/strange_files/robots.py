"""Cases of URDF and MJCF."""

import os

import numpy as np

from benchmarks.strange_files.making import (
    LIMIT,
    MJCF,
    OTHER,
    PART,
    ROOT,
    SPACED,
    STL_BOMB,
    TINY,
    WITH,
    Probe,
    color,
    grown,
    link,
    mesh,
    obj,
    robot,
    shape,
    volume,
)
from pipeline.intake.robots.add import RobotOptions, draft_robot
from tests.intake.robots.tiny import Tiny
from tests.world.meshes.files import dae

ROBOT_CASES = (
    # right values of a URDF
    Probe(
        "mirrored scale",
        shape("../meshes/cone.stl", "scale='1 -1 1'", **WITH),
        judge=lambda p: 4e-4 < volume(p) < 6e-4,
    ),
    Probe(
        "../meshes from urdf/",
        shape("../meshes/cone.stl", **WITH),
        judge=lambda p: 4e-4 < volume(p) < 6e-4,
    ),
    Probe("package by folder", shape("package://pkg/meshes/cone.stl", **WITH)),
    Probe(
        "package by package.xml",
        shape(
            "package://arm/meshes/cone.stl",
            pkg__package_DOT_xml=b"<package><name>arm</name></package>",
            **WITH,
        ),
    ),
    Probe("package beside", shape("package://tool/meshes/cone.stl", given=".", **WITH, **OTHER)),
    Probe(
        "OBJ in two colors",
        mesh(
            "a.obj",
            obj(
                "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n"
            ),
        ),
        judge=lambda p: color(p, (1, 0, 0), (0, 0, 1)),
    ),
    Probe(
        "DAE in two colors",
        mesh("a.dae", lambda p: dae(p, ((1, 0, 0), (0, 1, 0)))),
        judge=lambda p: color(p, (1, 0, 0), (0, 1, 0)),
    ),
    Probe(
        "DAE in centimetres",
        mesh("a.dae", lambda p: dae(p, unit='<unit meter="0.01"/>')),
        judge=lambda p: np.allclose(np.ptp(p.parts[0].points, axis=0), [0.01, 0.01, 0]),
    ),
    Probe(
        "floating root beyond the base",
        robot(TINY.replace("</robot>", ROOT.format("floating") + "</robot>"), base="base"),
    ),
    # refusals of a URDF
    Probe(
        "package that is not here",
        shape("package://gone/meshes/cone.stl", **WITH),
        "package 'gone', which is not here",
    ),
    Probe(
        "package of another's mesh",
        shape("package://tool/meshes/cone.stl", **WITH, **OTHER),
        "package 'tool', which is not here",
    ),
    Probe("mesh outside", shape("../../secret.stl"), "is outside of"),
    Probe("mesh by an absolute path", shape("/etc/hostname"), "is an absolute path"),
    Probe("mesh by URL", shape("https://example.org/a.stl"), "is a URL"),
    Probe("percent signs", shape("../meshes/my%20cone.stl", **SPACED), "was not found in"),
    Probe("backslashes", shape("..\\meshes\\cone.stl", **WITH), "was not found in"),
    Probe("wrong case", shape("../Meshes/CONE.STL", **WITH), "was not found in"),
    Probe(
        "mesh that is a link away",
        robot(PART, part_DOT_stl=link("/etc/hostname")),
        "is outside of|a link to a file outside",
    ),
    Probe(
        "mesh that is /dev/zero",
        robot(PART, part_DOT_stl=link("/dev/zero")),
        "a link to a file outside",
    ),
    Probe("mesh that is a pipe", robot(PART, part_DOT_stl=os.mkfifo), "is no regular file"),
    Probe("mesh of 40 GB", robot(PART, part_DOT_stl=grown), "a file has at most"),
    Probe("STL of 2 billion triangles", robot(PART, part_DOT_stl=STL_BOMB), "part.stl: "),
    Probe(
        "OBJ that is not finite",
        robot(Tiny(mesh="a.obj"), a_DOT_obj=b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "not finite",
    ),
    Probe(
        "limits of 0",
        robot(TINY.replace(LIMIT, 'lower="0" upper="0"')),
        "joint 'j3' has limits 0 to 0",
    ),
    Probe(
        "floating root",
        robot(TINY.replace("</robot>", ROOT.format("floating") + "</robot>")),
        "'free' is floating.*--base base",
    ),
    Probe(
        "planar root",
        robot(TINY.replace("</robot>", ROOT.format("planar") + "</robot>")),
        "'free' is planar",
    ),
    Probe(
        "laughs",
        robot('<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>' + TINY),
        "declares a document type",
    ),
    Probe(
        "XML of 100,000 levels",
        robot("<robot>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>"),
        "arm.urdf: ",
    ),
    Probe(
        "100,000 links",
        robot("<robot>" + "<link name='a'/>" * 100_000 + "</robot>"),
        "has 100000 links",
    ),
    Probe("link named as a path", robot(TINY.replace('"upper"', '"../../up"')), "without slashes"),
    Probe(
        "URDF that is /dev/zero",
        lambda f: (
            link("/dev/zero")(f / "arm.urdf"),
            draft_robot(f / "arm.urdf", RobotOptions("m", f)),
        )[1],
        "is no regular file",
    ),
    Probe(
        "URDF that is a pipe",
        lambda f: (os.mkfifo(f / "arm.urdf"), draft_robot(f / "arm.urdf", RobotOptions("m", f)))[1],
        "arm.urdf",
    ),
    # MJCF
    Probe(
        "MJCF of 10^8 replicas",
        robot(
            MJCF.format("", '<replicate count="100000000"><geom size=".1"/></replicate>'),
            name="a.xml",
        ),
        "a.xml",
    ),
    Probe(
        "MJCF with a field of 200000^2",
        robot(
            MJCF.format(
                '<asset><hfield name="h" nrow="200000" ncol="200000" size="1 1 1 1"/></asset>', ""
            ),
            name="a.xml",
        ),
        "a.xml",
    ),
    Probe(
        "MJCF that includes a pipe",
        robot(MJCF.format('<include file="p.xml"/>', ""), name="a.xml", p_DOT_xml=os.mkfifo),
        "is no regular file",
    ),
    Probe(
        "MJCF that includes /etc/passwd",
        robot(MJCF.format('<include file="/etc/passwd"/>', ""), name="a.xml"),
        "which is outside of",
    ),
    Probe(
        "MJCF with a texture elsewhere",
        robot(
            MJCF.format('<asset><texture type="2d" file="../../../../secret.png"/></asset>', ""),
            name="a.xml",
        ),
        "which is outside of",
    ),
    Probe(
        "MJCF in a ring",
        robot(MJCF.format('<include file="a.xml"/>', ""), name="a.xml"),
        "twice or in a ring",
    ),
)
