"""glTF of others: each feature that changes shapes or colors is applied, or refused by its name."""

import base64
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipeline.poses import quat_about
from pipeline.world.meshes.part import MeshError, srgb
from pipeline.world.meshes.reader import read_mesh
from tests.world.meshes.files import RED_LEFT, SQUARE, TWO, UV, Glb, png


@pytest.fixture
def glb():
    return Glb()


def one(path):
    """The only part of a file, which has nothing to note."""
    read = read_mesh(path)
    assert read.notes == () and read.up == "y"
    (part,) = read.parts
    return part


def area(part):
    a, b, c = part.points[part.faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a).sum(0) / 2


def colors_at(part):
    """Pixels (P,3) of the texture at the part's points; its edge for those on it."""
    h, w = part.look.texture.shape[:2]
    at = np.clip((part.uv % 1 * (w, h)).astype(int), 0, (w - 1, h - 1))
    return part.look.texture[at[:, 1], at[:, 0], :3]


def test_quantized_positions_are_numbers_of_their_range(tmp_path, glb):
    glb.primitive["attributes"]["POSITION"] = glb.accessor(
        (SQUARE * 32767).astype(np.int16), normalized=True
    )
    assert_allclose(
        one(glb.write(tmp_path / "a.glb", extensionsRequired=["KHR_mesh_quantization"])).points,
        SQUARE,
    )
    glb.primitive["attributes"]["POSITION"] = glb.accessor((SQUARE * 200).astype(np.uint8))
    glb.document["nodes"][0]["scale"] = [0.005] * 3
    assert_allclose(one(glb.write(tmp_path / "b.glb")).points, SQUARE, atol=1e-7)


def test_strides_and_offsets_are_read_and_sparse_values_refused(tmp_path, glb):
    wide = np.concatenate([SQUARE + 9, SQUARE], axis=1)  # interleaved: the second half of each row
    glb.primitive["attributes"]["POSITION"] = glb.accessor(wide[:, :3].copy())
    entry = glb.document["accessors"][-1]
    entry["bufferView"] = glb.view(wide.tobytes())
    entry["byteOffset"] = 12
    glb.document["bufferViews"][-1]["byteStride"] = 24
    assert_allclose(one(glb.write(tmp_path / "a.glb")).points, SQUARE)
    entry["sparse"] = {"count": 1}
    with pytest.raises(MeshError, match="has a sparse array"):
        read_mesh(glb.write(tmp_path / "b.glb"))


@pytest.mark.parametrize("corners", [TWO, None])
def test_lists_with_and_without_indices_make_the_same_square(tmp_path, glb, corners):
    if corners is None:
        del glb.primitive["indices"]
        glb.primitive["attributes"]["POSITION"] = glb.accessor(SQUARE[TWO])
    else:
        glb.primitive["indices"] = glb.accessor(np.array(corners, np.uint32))
    part = one(glb.write(tmp_path / "a.glb"))
    assert len(part.faces) == 2
    assert_allclose(area(part), [0, 0, 1])


def test_a_mirroring_node_keeps_the_outside_out(tmp_path, glb):
    turn = quat_about((0, 0, 1), np.pi / 2)
    place = {"translation": [0, 0, 2], "rotation": [*turn[1:], turn[0]], "scale": [1, -1, 3]}
    glb.document["nodes"] = [
        {"children": [1], "matrix": np.eye(4).T.ravel().tolist()},
        {"mesh": 0} | place,
    ]
    part = one(glb.write(tmp_path / "a.glb"))
    assert_allclose(part.points.max(0), [1, 1, 2], atol=1e-9)
    assert_allclose(area(part), [0, 0, 1], atol=1e-9)


def test_a_factor_is_linear_and_multiplies_a_texture(tmp_path, glb):
    glb.surface["baseColorFactor"] = [0.5, 0.25, 0.0, 1.0]
    assert_allclose(one(glb.write(tmp_path / "a.glb")).look.color, srgb(np.array([0.5, 0.25, 0.0])))
    glb.primitive["attributes"]["TEXCOORD_0"] = glb.accessor(UV)
    glb.texture(np.full((2, 2, 3), 255))
    part = one(glb.write(tmp_path / "b.glb"))
    assert_allclose(part.look.texture[0, 0, :3], 255 * srgb(np.array([0.5, 0.25, 0.0])), atol=1)
    assert part.uv.tolist() == UV.tolist()


def test_a_primitive_without_a_material_states_no_color(tmp_path, glb):
    del glb.primitive["material"]
    assert one(glb.write(tmp_path / "a.glb")).look.color is None


def test_coordinates_are_of_the_set_that_the_texture_names_and_transformed(tmp_path, glb):
    left = UV * [0.4, 1]
    glb.primitive["attributes"] |= {
        "TEXCOORD_0": glb.accessor(UV),
        "TEXCOORD_1": glb.accessor(left.astype(np.float32)),
    }
    glb.texture(RED_LEFT, texCoord=1)
    assert (colors_at(one(glb.write(tmp_path / "a.glb"))) == [255, 0, 0]).all()
    change = {"offset": [0.6, 0.1], "scale": [0.5, 1.0], "texCoord": 1}
    glb.surface["baseColorTexture"]["extensions"] = {"KHR_texture_transform": change}
    part = one(glb.write(tmp_path / "b.glb"))
    assert_allclose(part.uv, left * [0.5, 1] + [0.6, 0.1], atol=1e-6)
    assert (colors_at(part) == [0, 0, 255]).all()
    # a positive angle turns coordinates from u towards -v: counter-clockwise, as v runs down
    change |= {"rotation": np.pi / 2, "offset": [0, 0], "scale": [1, 1], "texCoord": 0}
    assert_allclose(one(glb.write(tmp_path / "c.glb")).uv, UV @ [[0, -1], [1, 0]], atol=1e-6)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_colors_of_vertices_become_a_palette_times_the_factor(tmp_path, glb, kind):
    top = 1 if kind is np.float32 else np.iinfo(kind).max
    shades = np.array([[1, 0, 0, 1], [1, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1]]) * top
    glb.primitive["attributes"]["POSITION"] = glb.accessor(SQUARE[TWO])
    glb.primitive["attributes"]["COLOR_0"] = glb.accessor(
        shades[[0, 1, 2, 3, 3, 3]].astype(kind), kind is not np.float32
    )
    del glb.primitive["indices"]
    glb.surface["baseColorFactor"] = [0.5, 0.5, 0.5, 1]
    part = one(glb.write(tmp_path / "a.glb"))
    half = round(255 * float(srgb(np.array(0.5))))
    assert_allclose(colors_at(part)[[0, 3]], [[half, 0, 0], [0, half, 0]], atol=4)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("KHR_draco_mesh_compression", "is packed by KHR_draco_mesh_compression: .*gltf-transform"),
        ("EXT_meshopt_compression", "is packed by EXT_meshopt_compression: .*gltf-transform"),
        ("EXT_mesh_gpu_instancing", "requires the extension 'EXT_mesh_gpu_instancing'"),
        ("VENDOR_shape", "requires the extension 'VENDOR_shape', which is not read"),
    ],
)
def test_extensions_that_would_change_the_shape_are_refused_by_name(tmp_path, glb, name, words):
    with pytest.raises(MeshError, match=f"a.glb: .*{words}"):
        read_mesh(glb.write(tmp_path / "a.glb", extensionsUsed=[name], extensionsRequired=[name]))


def test_what_is_not_drawn_as_stated_is_noted(tmp_path, glb):
    glb.primitive["targets"] = [{"POSITION": 0}]
    glb.document["nodes"][0]["skin"] = 0
    glb.document["materials"][0]["alphaMode"] = "BLEND"
    glb.texture(RED_LEFT)
    glb.document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 1})
    said = " ".join(
        read_mesh(glb.write(tmp_path / "a.glb", extensionsUsed=["KHR_materials_clearcoat"])).notes
    )
    for words in (
        "morph targets",
        "skin",
        "transparent",
        "no TEXCOORD_0",
        "points, lines, strips or fans",
        "KHR_materials_clearcoat",
    ):
        assert words in said


def test_a_gltf_names_its_buffer_and_image_with_percent_signs_or_holds_them(tmp_path, glb):
    glb.primitive["attributes"]["TEXCOORD_0"] = glb.accessor(UV)
    glb.texture(RED_LEFT)
    (tmp_path / "my data.bin").write_bytes(glb.blob)
    (tmp_path / "my image.png").write_bytes(png(RED_LEFT))
    inline = "data:application/octet-stream;base64," + base64.b64encode(glb.blob).decode()
    for uri, image in (("my%20data.bin", "my%20image.png"), (inline, "my%20image.png")):
        files = {"buffers": [{"byteLength": len(glb.blob), "uri": uri}], "images": [{"uri": image}]}
        (tmp_path / "a.gltf").write_text(json.dumps(glb.document | files))
        assert one(tmp_path / "a.gltf").look.texture.shape == (2, 2, 4)
    (tmp_path / "a.gltf").write_text(
        json.dumps(glb.document | files | {"images": [{"uri": "gone.png"}]})
    )
    with pytest.raises(MeshError, match=r"'gone\.png' was not found"):
        read_mesh(tmp_path / "a.gltf")


def test_deep_and_many_nodes_end_at_once(tmp_path, glb):
    chain = [{"children": [k + 1]} for k in range(40_000)]
    assert len(one(glb.write(tmp_path / "deep.glb", nodes=[*chain, {"mesh": 0}])).faces) == 2
    with pytest.raises(MeshError, match="has 100000 nodes"):
        read_mesh(glb.write(tmp_path / "many.glb", nodes=[{"mesh": 0}] * 100_000))
    glb.primitive["indices"] = glb.accessor(np.tile(TWO, 50_000))
    with pytest.raises(MeshError, match="has more than 500000 triangles"):
        read_mesh(
            glb.write(
                tmp_path / "often.glb", nodes=[{"mesh": 0}] * 6, scenes=[{"nodes": [*range(6)]}]
            )
        )
