"""Meshes that a URDF names: where they are found, which way they face, and the colors that reach
the image."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from pipeline.data.cameras import Camera, CameraType, look
from pipeline.poses import pose
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.meshes.part import MeshLook, Part, srgb
from pipeline.world.meshes.reader import drawn
from pipeline.world.robots.surfaces import load_visual, surface
from pipeline.world.robots.urdf_file import UrdfError, UrdfShape, read_urdf
from tests.world.meshes.files import SQUARE, TWO, Glb, dae

NAMED = (
    "<robot><link name='a'><visual>{origin}<geometry><mesh"
    " filename='{name}'{scale}/></geometry>{color}</visual></link></robot>"
)
CONE = trimesh.creation.cone(0.05, 0.2)


def urdf(path, name, scale="", color="", origin=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        NAMED.format(
            name=name, scale=f" scale='{scale}'" if scale else "", color=color, origin=origin
        )
    )
    return path


def only(robot) -> UrdfShape:
    (shape,) = robot.links["a"].visuals
    return shape


@pytest.mark.parametrize("scale", ["1 -1 1", "-1 -1 -1", "1 1 1", "-2 1 1"])
def test_a_mirrored_mesh_still_faces_outwards(tmp_path, scale):
    CONE.export(tmp_path / "cone.stl")
    shape = only(
        read_urdf(
            urdf(
                tmp_path / "a.urdf",
                "cone.stl",
                scale,
                origin="<origin xyz='1 2 3' rpy='0.3 0.2 0.1'/>",
            )
        )
    )
    points, faces = surface(shape)
    grows = abs(np.prod([float(v) for v in scale.split()]))
    assert trimesh.Trimesh(points, faces).volume == pytest.approx(CONE.volume * grows, rel=1e-5)
    ((mesh, _),) = load_visual([shape])
    middle = mesh.vertices.mean(0)
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.vertices - middle) > 0).mean() > 0.9


def test_meshes_lie_beside_the_urdf_or_in_packages_by_name(tmp_path):
    mine, tool = tmp_path / "ws" / "my_arm", tmp_path / "ws" / "tool"
    for folder in (mine / "meshes", tool / "meshes"):
        folder.mkdir(parents=True)
        CONE.export(folder / "cone.stl")
    (mine / "package.xml").write_text("<package><name> arm_description </name></package>")
    path = mine / "urdf" / "a.urdf"
    for name in (
        "../meshes/cone.stl",
        "package://my_arm/meshes/cone.stl",
        "package://arm_description/meshes/cone.stl",
    ):
        assert only(read_urdf(urdf(path, name))).file == mine / "meshes" / "cone.stl"
    urdf(path, "package://tool/meshes/cone.stl")
    # below its package.xml only; in the directory that is given; in the directory that is named
    with pytest.raises(
        UrdfError, match="is of the package 'tool', which is not here: give --package tool=DIR"
    ):
        read_urdf(path)
    assert only(read_urdf(path, tmp_path / "ws")).file == tool / "meshes" / "cone.stl"
    assert only(read_urdf(path, packages={"tool": tool})).file == tool / "meshes" / "cone.stl"
    # no other package's mesh of the same name
    with pytest.raises(UrdfError, match="package 'gone_description', which is not here"):
        read_urdf(urdf(path, "package://gone_description/meshes/cone.stl"), tmp_path / "ws")
    with pytest.raises(UrdfError, match="is outside of"):
        read_urdf(urdf(path, "package://tool/../my_arm/meshes/cone.stl"), packages={"tool": tool})
    with pytest.raises(UrdfError, match="is outside of"):
        read_urdf(urdf(path, "../../tool/meshes/cone.stl"))


def image(parts):
    """Parts (within 1 m, seen from above) as they are drawn, (60,240,3)."""
    camera = Camera(
        "above", CameraType(240, 60, 20.0), None, look((0, 0, 3.0), (0, 0, -1), (-1, 0, 0))
    )
    with Renderer({"all": parts}, (), [camera], CLEAN, "raster") as renderer:
        return renderer.render({"all": pose((0, 0, 0.75))[None]})[0].rgb[0].astype(int)


def test_the_colors_of_obj_dae_glb_and_urdf_reach_the_image(tmp_path):
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0.1 0.1\nnewmtl b\nKd 0.1 0.2 1\n")
    dae(tmp_path / "a.dae", colors=((0.1, 0.8, 0.2),))
    glb = Glb()
    glb.surface["baseColorFactor"] = [0.6, 0.3, 0.05, 1]
    glb.write(tmp_path / "a.glb")
    trimesh.Trimesh(SQUARE, TWO.reshape(-1, 3)).export(tmp_path / "a.stl")
    grey, lilac = (
        f"<material name='x'><color rgba='{rgb} 1'/></material>"
        for rgb in ("0.5 0.5 0.5", "0.7 0.3 0.9")
    )
    files = (("a.obj", grey), ("a.dae", grey), ("a.glb", grey), ("a.stl", lilac))
    shapes, expected = [], []
    first, second = [0, 1, 2], [0, 2, 3]
    colors = [
        [((1, 0.1, 0.1), [first]), ((0.1, 0.2, 1), [second])],
        [((0.1, 0.8, 0.2), [first, second])],
    ]
    colors += [
        [(tuple(srgb(np.array([0.6, 0.3, 0.05]))), [first, second])],
        [((0.7, 0.3, 0.9), [first, second])],
    ]
    for k, ((name, material), looks) in enumerate(zip(files, colors, strict=True)):
        place = f"<origin xyz='{0.5 * k - 1} -0.2 0'/>"
        shapes.append(only(read_urdf(urdf(tmp_path / f"{k}.urdf", name, "0.45", material, place))))
        points = SQUARE.astype(float) * 0.45 + [0.5 * k - 1, -0.2, 0]
        expected += [Part(points, np.array(faces), MeshLook(color)) for color, faces in looks]
    found, reference = image(load_visual(shapes)), image(drawn(expected, 100, 2))
    assert_allclose(found, reference, atol=3)
    # a color for each: not all grey
    middles = [found[30, x] for x in (65, 99, 137, 175)]
    assert (
        all(np.ptp(color) > 40 for color in middles)
        and len({int(np.argmax(c)) for c in middles}) == 3
    )
