"""COLLADA of others: units, polygons of every kind, several materials, textures."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipeline.world.meshes.part import MeshError
from pipeline.world.meshes.reader import read_mesh
from tests.world.meshes.files import RED_LEFT, dae, png

VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'


def test_the_unit_of_the_file_and_its_nodes_are_applied(tmp_path):
    place = "<translate>0 0 100</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
    read = read_mesh(dae(tmp_path / "a.dae", unit='<unit name="cm" meter="0.01"/>', place=place))
    assert_allclose(np.ptp(read.parts[0].points, axis=0), [0.01, 0.02, 0], atol=1e-9)
    assert_allclose(read.parts[0].points[:, 2], 1.0)
    assert read.up == "z" and read.notes == ()


def test_each_material_has_its_diffuse_color(tmp_path):
    read = read_mesh(dae(tmp_path / "a.dae", colors=((1, 0, 0), (0, 0.5, 1))))
    assert [part.look.color for part in read.parts] == [(1, 0, 0), (0, 0.5, 1)]


@pytest.mark.parametrize(
    "primitive",
    [
        f"<polylist count='1'>{VERTEX}<vcount>4</vcount><p>0 1 2 3</p></polylist>",
        f"<polygons count='1'>{VERTEX}<p>0 1 2 3</p></polygons>",
        f"<triangles count='2'>{VERTEX}<p>0 1 2 0 2 3</p></triangles>",
        f"<tristrips count='1'>{VERTEX}<p>0 1 3 2</p></tristrips>",
        f"<trifans count='1'>{VERTEX}<p>0 1 2 3</p></trifans>",
        f"<lines count='1'>{VERTEX}<p>0 1</p></lines><!-- no shape -->"
        f"<triangles count='2'>{VERTEX}<p>0 1 2 0 2 3</p></triangles>",
    ],
)
def test_polygons_and_triangles_make_the_same_square(tmp_path, primitive):
    (part,) = read_mesh(dae(tmp_path / "a.dae", primitives=[primitive])).parts
    a, b, c = part.points[part.faces].transpose(1, 0, 2)
    assert_allclose(np.cross(b - a, c - a).sum(0) / 2, [0, 0, 1])


def test_a_texture_is_read_by_way_of_its_sampler(tmp_path):
    (tmp_path / "red left.png").write_bytes(png(RED_LEFT))
    texels = '<input semantic="TEXCOORD" source="#t" offset="0" set="0"/>'
    path = dae(
        tmp_path / "a.dae",
        primitives=[
            f'<triangles count="2" material="m0">{VERTEX}{texels}<p>0 1 2 0 2 3</p></triangles>'
        ],
    )
    surface = '<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>'
    sampler = '<newparam sid="s2"><sampler2D><source>f</source></sampler2D></newparam>'
    text = path.read_text().replace(
        "<color>1 0 0 1</color>", '<texture texture="s2" texcoord="UV"/>'
    )
    text = text.replace("<profile_COMMON>", f"<profile_COMMON>{surface}{sampler}")
    images = (
        "<library_images><image"
        ' id="i"><init_from>{}</init_from></image></library_images><library_effects>'
    )
    path.write_text(text.replace("<library_effects>", images.format("red%20left.png")))
    (part,) = read_mesh(path).parts
    assert part.look.texture.shape == (2, 2, 4)
    assert_allclose(part.uv[0], [0, 0])  # v = 1 above, which is where an image begins
    path.write_text(text.replace("<library_effects>", images.format("gone.png")))
    read = read_mesh(path)
    assert (
        "has no texture: 'gone.png' was not found" in read.notes[0]
        and read.parts[0].look.texture is None
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<COLLADA", '<!DOCTYPE a [<!ENTITY b "c">]><COLLADA', "declares a document type"),
        ("</COLLADA>", "", "not readable as XML"),
        ("<p>0 1 2 0 2 3</p>", "<p>0 1 2 0 2 9</p>", "go beyond the limits of the source"),
        ("<p>0 1 2 0 2 3</p>", "<p>0 1 2 0 2 -1</p>", "vertices that it does not hold"),
        ("<p>0 1 2 0 2 3</p>", "<ph><p>0 1 2 0 2 3</p></ph>", "Missing index"),
        (
            "<p>0 1 2 0 2 3</p></triangles>",
            "</triangles><trifans><p>0 1</p></trifans>",
            "Missing index",
        ),
        ('url="#g"', 'url="#gone"', "Geometry #gone not found"),
        ("<node>", "<node><skew>1 2 3</skew>", "Unknown scene node .*skew"),
        ("<node>", '<node id="n"><instance_node url="#n"/>', "Node #n not found"),
        ("<asset>", '<asset><unit meter="0"/>', "has a unit of 0 metres"),
    ],
)
def test_what_is_wrong_is_refused(tmp_path, old, new, words):
    path = dae(tmp_path / "a.dae")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(MeshError, match=words) as error:
        read_mesh(path)
    assert "\n" not in str(error.value)
