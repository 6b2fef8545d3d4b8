"""OBJ and MTL of others: what is stated is read; what is guessed or missing has a line each."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipeline.world.meshes.part import MeshError, srgb
from pipeline.world.meshes.reader import read_mesh
from pipeline.world.shapes import linear
from tests.world.meshes.files import RED_LEFT, png

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
TEXELS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def put(folder, obj, mtl="", **images):
    (folder / "a.obj").write_text(obj)
    (folder / "a.mtl").write_text(mtl)
    return folder / "a.obj"


def test_each_material_is_a_part_of_its_color_however_many_groups_there_are(tmp_path):
    groups = "".join(f"g group{k}\nusemtl {'ab'[k % 2]}\nf -4 -3 -2 -1\n" for k in range(20_000))
    read = read_mesh(
        put(tmp_path, f"mtllib a.mtl\n{SQUARE}{groups}", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0.2\n")
    )
    assert [part.look.color for part in read.parts] == [
        (1, 0, 0),
        (0.2, 0.2, 0.2),
    ] and read.notes == ()
    assert sum(len(part.faces) for part in read.parts) == 40_000


def test_lines_continue_and_corners_count_back(tmp_path):
    (part,) = read_mesh(put(tmp_path, SQUARE + "f -4 \\\n -3 \\\n -2\n")).parts
    assert_allclose(part.points[part.faces[0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    assert part.look.color is None


@pytest.mark.parametrize(
    ("line", "note"),
    [
        ("map_Kd img/red.png", ""),
        ("map_Kd -clamp on img/red.png", "has no texture: '-clamp on img/red.png' was not found"),
        ("map_Kd img\\red.png", "has no texture: 'img"),
        ("map_Kd IMG/Red.PNG", "'IMG/Red.PNG' was not found"),
        ("map_Kd /home/me/beside.png", "is an absolute path"),
        ("map_Kd two words.png", ""),
        ("map_Kd gone.png", "has no texture: 'gone.png' was not found"),
    ],
)
def test_a_texture_is_found_as_it_is_written_or_noted(tmp_path, line, note):
    (tmp_path / "img").mkdir()
    for name in ("img/red.png", "beside.png", "two words.png"):
        (tmp_path / name).write_bytes(png(RED_LEFT))
    text = f"mtllib a.mtl\n{SQUARE}{TEXELS}usemtl a\n{FACE}"
    read = read_mesh(put(tmp_path, text, f"newmtl a\nKd 0.5 0.5 0.5\n{line}\n"))
    (part,) = read.parts
    assert note in " ".join(read.notes) and bool(note) == bool(read.notes)
    if note:
        assert part.look.texture is None and part.look.color == (0.5, 0.5, 0.5)
        return
    # times Kd, in linear light; v runs down
    half = 255 * float(srgb(linear(np.array(0.5))))
    assert_allclose(part.look.texture[0, 0, :3], [half, 0, 0], atol=1)
    assert_allclose(part.uv[np.argmin(np.abs(part.points).sum(1))], [0, 1])


def test_colors_of_vertices_are_a_palette(tmp_path):
    points = (
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 0 0 1\nv 1 2 0 0 0 1\nv 2 2 0 0 0 1\n"
    )
    (part,) = read_mesh(put(tmp_path, points + "f 1 2 3\nf 4 5 6\n")).parts
    at = (part.uv * part.look.texture.shape[1::-1]).astype(int)
    shades = part.look.texture[at[:, 1], at[:, 0], :3]
    assert shades[:3].tolist() == [[255, 0, 0]] * 3 and shades[3:].tolist() == [[0, 0, 255]] * 3
    (part,) = read_mesh(
        put(tmp_path, "v 0 0 0 0 1 0\nv 1 0 0 0 1 0\nv 1 1 0 0 1 0\nf 1 2 3\n")
    ).parts
    assert part.look.texture is None and part.look.color == (0, 1, 0)


@pytest.mark.parametrize(
    ("obj", "mtl", "words"),
    [
        (f"mtllib a.mtl\n{SQUARE}f 1 2 3\n", "newmtl a\nKd 1 0 0\n", "uses none of it"),
        (
            f"mtllib gone.mtl\n{SQUARE}usemtl a\nf 1 2 3\n",
            "",
            "has no material library: 'gone.mtl' was not found",
        ),
        (
            f"mtllib gone.mtl\n{SQUARE}usemtl a\nf 1 2 3\n",
            "",
            "uses the material 'a', which no mtllib holds",
        ),
        (
            f"mtllib a.mtl\n{SQUARE}usemtl a\nf 1 2 3\n",
            "newmtl a\nmap_Kd red.png\n",
            "no coordinates for it",
        ),
        (f"mtllib a.mtl\n{SQUARE}usemtl a\nf 1 2 3\n", "newmtl a\nd 0.5\n", "transparent"),
        (
            SQUARE.replace("0 0 0", "0 0 0 1 1 1", 1) + "f 1 2 3\n",
            "",
            "without a color among others",
        ),
    ],
)
def test_what_is_missing_has_a_line(tmp_path, obj, mtl, words):
    assert words in " ".join(read_mesh(put(tmp_path, obj, mtl)).notes)


@pytest.mark.parametrize(
    ("obj", "mtl", "words"),
    [
        (f"{SQUARE}f 1 2 9\n", "", "a triangle of vertices that it does not hold"),
        (f"{SQUARE}f 0 1 2\n", "", "a triangle of vertices that it does not hold"),
        (f"{SQUARE}f 1/7 2/7 3/7\n", "", "a triangle of vertices that it does not hold"),
        ("v 0 0\nf 1 1 1\n", "", "fewer than 3 numbers"),
        (SQUARE, "", "holds no triangles"),
        (f"{SQUARE}f a b c\n", "", "not readable"),
        (f"mtllib ../a.mtl\n{SQUARE}f 1 2 3\n", "", "is outside of"),
        (
            f"mtllib a.mtl\n{SQUARE}{TEXELS}usemtl a\n{FACE}",
            "newmtl a\nmap_Kd a.obj\n",
            "a texture that is no image",
        ),
    ],
)
def test_what_is_wrong_is_refused(tmp_path, obj, mtl, words):
    with pytest.raises(MeshError, match=words) as error:
        read_mesh(put(tmp_path, obj, mtl))
    assert "\n" not in str(error.value)
