"""The shadow map's geometry against rays cast from the sun."""

import numpy as np
import pytest

from pipeline.world.drawing.masks import FAR, SOFTEST, Depths, Ground, hard, soft
from pipeline.world.drawing.shadows import (
    SHADOW_CENTRE,
    SHADOW_DEPTH,
    SHADOW_HALF_SIZE,
    SHADOW_MAP,
    SHADOW_OFFSET,
    plane_depths,
    sun_axes,
    table_window,
)
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP


def ground(table: Depths) -> Ground:
    """A table as large as the map, and a floor where it is."""
    return Ground(table, table, 2 * SHADOW_DEPTH, (slice(None), slice(None)))


SUNS = [(0.0, 0.5, -1.0), (0.6, 0.2, -1.0), (-2.0, 0.0, -0.1)]


@pytest.mark.parametrize("direction", SUNS)
def test_axes_are_right_handed_and_follow_the_light(direction: tuple) -> None:
    axes = sun_axes(direction)
    assert np.allclose(axes @ axes.T, np.eye(3)) and np.isclose(np.linalg.det(axes), 1)
    assert np.allclose(axes[2] * np.linalg.norm(direction), direction)


@pytest.mark.parametrize("direction", SUNS)
def test_a_ray_through_a_texel_meets_the_plane_at_its_depth(direction: tuple) -> None:
    depths, axes = plane_depths(0.74, direction), sun_axes(direction)
    for row, column in ((10, 20), (224, 224), (300, 440)):
        x = SHADOW_HALF_SIZE * (1 - 2 * (column + 0.5) / SHADOW_MAP)  # mirrored
        y = SHADOW_HALF_SIZE * (2 * (row + 0.5) / SHADOW_MAP - 1)
        start = np.array(SHADOW_CENTRE) + x * axes[0] + y * axes[1] - SHADOW_DEPTH * axes[2]
        along = (0.74 + SHADOW_OFFSET - start[2]) / axes[2, 2]
        assert depths[row, column] == pytest.approx(
            np.clip(along / (2 * SHADOW_DEPTH), 0, 1), abs=1e-6
        )


def test_a_plane_along_the_light_gets_no_shadow() -> None:
    assert not plane_depths(0.0, (0.3, 1.0, 0.0)).any()


@pytest.mark.parametrize("direction", SUNS)
def test_masks_of_the_table_are_those_of_the_whole_map(direction: tuple) -> None:
    table, axes, window = (
        plane_depths(TABLE_TOP, direction),
        sun_axes(direction),
        table_window(direction),
    )
    depths = np.where(np.random.default_rng(0).random(table.shape) < 0.2, table - 0.02, 1.0).astype(
        np.float32
    )
    whole, part = (
        soft(depths, ground(table)),
        soft(depths, Ground(table, table, 2 * SHADOW_DEPTH, window)),
    )
    x, y = np.moveaxis(
        np.mgrid[-1:1:9j, -1:1:9j].reshape(2, -1).T
        * TABLE_HALF
        @ axes[:2, :2].T
        / SHADOW_HALF_SIZE,
        -1,
        0,
    )
    at = np.clip(
        np.rint((np.stack([y, -x]) * 0.5 + 0.5) * SHADOW_MAP).astype(int), 2, SHADOW_MAP - 3
    )
    assert np.array_equal(whole[*at], part[*at]) and np.ptp(whole[*at], axis=0)[0] > 0


def test_light_is_the_mean_over_nine_texels_and_the_border_is_lit() -> None:
    depths, plane = np.ones((16, 16), np.float32), np.full((16, 16), 0.5, np.float32)
    depths[6:9, 7] = 0.3  # three texels nearer to the sun than the plane
    light = hard(depths, ground(plane))[..., 0]
    assert light[7, 7] == 170 and light[7, 5] == 255 and light[5, 8] == round(255 * 8 / 9)
    depths[:] = 0.1
    light = hard(depths, ground(plane))[..., 0]
    assert (light[:2] == 255).all() and (light[:, -2:] == 255).all() and not light[3:-3, 3:-3].any()


def test_the_edge_of_a_soft_shadow_widens_with_the_height_of_the_body() -> None:
    span, table = 2 * SHADOW_DEPTH, np.full((128, 128), 0.5, np.float32)
    widths = []
    for height in (0.01, 0.5 * SOFTEST, 2 * SOFTEST):
        depths = np.ones((128, 128), np.float32)
        depths[:, 64:] = 0.5 - height / span
        light = soft(depths, ground(table))[64, :, 0].astype(int)
        assert (
            (light[10:40] == 255).all()
            and (light[88:118] == 0).all()
            and (np.diff(light[10:118]) <= 0).all()
        )
        widths.append(np.count_nonzero((light[10:118] > 5) & (light[10:118] < 250)))
    assert widths[0] <= 4 and widths[0] < widths[1] < widths[2] <= FAR + 2


def test_what_lies_on_the_table_takes_light_from_it_and_what_is_high_does_not() -> None:
    span, table = 2 * SHADOW_DEPTH, np.full((64, 64), 0.5, np.float32)
    lying = -SHADOW_OFFSET * 1.25  # light is looked up that far off the table, along a slanted sun
    # the last is the table's own underside
    for height, darkened in ((lying, True), (0.0, True), (0.2, False), (-0.05, False)):
        depths = np.ones((64, 64), np.float32)
        depths[20:40, 20:40] = 0.5 - height / span
        sun, _, room, _ = np.moveaxis(soft(depths, ground(table)), -1, 0)
        assert (sun[30, 30] == 0) == (height > -0.01)
        assert (
            room[5, 5] == 255
            and (room[30, 30] < 130) == darkened
            and (room[30, 30] == 255) != darkened
        )
