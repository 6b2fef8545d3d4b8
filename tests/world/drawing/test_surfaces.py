"""Grids cover the rectangles they came from; textures are as fine as asked."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.episode.visuals import FIRST_LOOK
from pipeline.world.drawing import room
from pipeline.world.drawing.surfaces import channel, embossed, grid, halved, prepared, texture_level
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.shapes import Material, Mesh


def area(mesh: Mesh) -> np.ndarray:
    """Vector area (3,): length of the triangles' areas along their normals."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    return np.cross(b - a, c - a).sum(0) / 2


def test_a_grid_covers_the_rectangle_and_its_texture() -> None:
    wall = room.quad((-1, 2, 0), (3, 0, 0), (0, 0, 1.5), 0.5)
    fine = grid(wall, 0.5)
    assert (
        len(fine.triangles) == 2 * 6 * 3
        and np.allclose(area(fine), area(wall))
        and np.allclose(fine.normals, wall.normals[0])
    )
    assert fine.uvs is not None
    assert np.allclose(
        fine.uvs, np.stack([fine.vertices[:, 0] + 1, fine.vertices[:, 2]], 1) / 0.5, atol=1e-5
    )


def test_the_underside_of_a_box_stays_whole() -> None:
    table = room.table_top(CLEAN)[0][0]
    fine = grid(table, 0.1)
    down = fine.normals[fine.triangles[:, 0], 2] < -0.5
    assert down.sum() == 2 and np.abs(area(fine)).max() < 1e-5  # closed
    ceiling = room.quad((0, 0, 3), (2, 0, 0), (0, -2, 0), 1.0)
    assert len(grid(ceiling, 0.5).triangles) == 2 * 16


@pytest.mark.parametrize(("pixel", "level"), [(0.001, 0), (0.002, 1), (0.0041, 2), (0.1, 3)])
def test_texture_level_brings_a_texel_to_a_pixel(pixel: float, level: int) -> None:
    floor = room.quad((0, 0, 0), (4, 0, 0), (0, 4, 0), 0.256)  # texels of 1 mm
    assert texture_level(floor, np.zeros((256, 256, 4), np.uint8), pixel) == level


def test_halving_averages() -> None:
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 256, (8, 12, 4)).astype(np.uint8)
    half = halved(texture, 1)
    assert (
        half.shape == (4, 6, 4) and abs(float(half[1, 2, 3]) - texture[2:4, 4:6, 3].mean()) <= 0.5
    )
    assert halved(texture, 5).shape == (2, 3, 4) and halved(texture, 0) is texture


def test_light_from_a_side_falls_on_the_slopes_that_face_it() -> None:
    texture = np.full((8, 16, 4), 120, np.uint8)
    texture[:, 8:] = 140  # higher on the right
    parts = [
        (
            room.quad((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0),
            Material((0.5, 0.5, 0.5), texture=texture),
        )
    ]
    for travels, brighter in (((0.5, 0.0, -1.0), True), ((-0.5, 0.0, -1.0), False)):
        lit = embossed(parts, travels)[0][1].texture
        assert (
            lit is not None
            and (lit[0, 7:9, 0] > texture[0, 7:9, 0]).all() == brighter
            and np.array_equal(lit[:, 2:6], texture[:, 2:6])
        )
    across = embossed(parts, (0.0, 0.7, -1.0))[0][1].texture
    assert across is not None and np.array_equal(across, texture)


def test_planes_of_the_room_are_prepared_for_a_camera_type() -> None:
    for name, parts in room.shell(CLEAN).items():
        (mesh, material), (fine, same) = parts[0], prepared(name, parts, CAMERA_TYPES["D435"])[0]
        assert len(fine.triangles) > len(mesh.triangles) and same.roughness == material.roughness
    assert len({channel(name) for name in ("the table", "the floor", "the ceiling")}) == 3
    assert channel("the ceiling") == channel("the back wall")


def test_cloth_has_no_sheen_from_the_second_look_on() -> None:
    linen = replace(CLEAN, table=replace(CLEAN.table, pattern="linen"))
    sheen = [
        room.table_top(v)[0][1].roughness for v in (CLEAN, linen, replace(linen, look=FIRST_LOOK))
    ]
    assert sheen[0] == sheen[2] < sheen[1]
