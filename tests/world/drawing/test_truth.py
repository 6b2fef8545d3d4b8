"""Surfaces from triangles against what the renderer draws."""

import numpy as np

from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.room import shell, table_legs, table_top
from pipeline.world.drawing.silhouettes import occluders_of
from pipeline.world.drawing.truth import surfaces_of
from pipeline.world.looks.visuals import CLEAN
from tests.world.drawing.test_silhouettes import BODIES, CAMERA, POSES


def test_depth_and_bodies_are_those_of_the_renderer():
    """The last frame has a corner cut off by the near plane."""
    room = [part for parts in shell(CLEAN).values() for part in parts]
    found = surfaces_of(
        occluders_of(BODIES, [*table_legs(), *table_top(CLEAN), *room]), POSES, CAMERA
    )
    with Renderer(BODIES, [], [CAMERA], CLEAN) as renderer:
        (view,) = renderer.render(POSES, depth=True, segmentation=True)
    assert view.depth is not None and set(np.unique(found.segmentation)) == {0, 1, 2}
    assert (found.segmentation == view.segmentation).mean() > 0.999
    assert (np.abs(1000 * found.depth - view.depth) < 1).mean() > 0.999
    length = np.linalg.norm(found.normals.astype(float), axis=-1)
    np.testing.assert_allclose(length, 1, atol=2e-3)
