"""The renderer against closed-form projection, and its promises: same bytes everywhere, exact
masks, light that makes sense."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.data.cameras import Camera, CameraType, View, extrinsics_cv, intrinsics, look
from pipeline.data.episode.visuals import (
    FIRST_LOOK,
    LOOK,
    SECOND_LOOK,
    THIRD_LOOK,
    PointLight,
    Surface,
    Visuals,
)
from pipeline.poses import (
    Pose,
    compose,
    inverse,
    pose,
    quat_about,
    quat_from_rpy,
    quat_rotate,
    transform,
)
from pipeline.world.drawing.engine import FAR, NEAR, millimetres
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.room import ROOM, box
from pipeline.world.drawing.shadows import look_of
from pipeline.world.drawing.vulkan import NoRenderer, ensure_renderer
from pipeline.world.looks.materials import plastic
from pipeline.world.looks.visuals import CLEAN, draw_visuals
from pipeline.world.shapes import Material, Mesh, linear

try:
    ensure_renderer()
except NoRenderer as error:
    pytest.skip(str(error), allow_module_level=True)

KIND = CameraType(96, 72, 45.0)
HEAD = Camera("head", KIND, None, look((0.05, -0.5, 1.25), (0, 0.6, -0.62)))
HALF = np.array([0.06, 0.04, 0.05])
RADIUS = 0.05
BOX_POSE = pose((0.08, 0.05, 0.85), quat_from_rpy(0.3, -0.2, 0.7))
BALL_POSE = pose((-0.12, 0.0, 0.80))
MOUNT = pose((-0.25, 0.02, 0.1), quat_about((0, 1, 0), 0.4))


def sphere(radius: float, rings: int = 24) -> Mesh:
    """Latitude-longitude sphere with its vertices on the surface."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    n = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1
    )
    i = np.arange(n.shape[0] * n.shape[1]).reshape(n.shape[:2])
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    triangles = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    n = n.reshape(-1, 3).astype(np.float32)
    return Mesh(n * np.float32(radius), triangles.astype(np.uint32), n)


BODIES = {
    "ball": [(sphere(RADIUS), plastic("red"))],
    "nothing": [],
    "box": [(box((0, 0, 0), HALF), plastic("teal"))],
}
POSES = {"ball": BALL_POSE[None], "box": BOX_POSE[None], "nothing": pose((9, 9, 9))[None]}


def rays(camera: Camera, at: Pose) -> tuple[NDArray, NDArray]:
    """World origin (3,) and directions (H,W,3) through pixel centres, scaled to unit depth along
    the viewing axis."""
    u, v = np.meshgrid(np.arange(camera.type.width) + 0.5, np.arange(camera.type.height) + 0.5)
    seen = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(intrinsics(camera.type)).T
    return at[:3], seen @ extrinsics_cv(at)[:3, :3]


def slab_depth(origin: NDArray, direction: NDArray, half: NDArray, at: Pose) -> NDArray:
    """Depth (H,W) of a box by the slab method, inf where missed."""
    o, d = transform(inverse(at), origin), quat_rotate(inverse(at)[3:], direction)
    with np.errstate(divide="ignore"):
        near, far = np.sort(np.stack([(-half - o) / d, (half - o) / d]), axis=0)
    enter, leave = near.max(-1), far.min(-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def ball_depth(origin: NDArray, direction: NDArray, radius: float, centre: NDArray) -> NDArray:
    """Depth (H,W) of a sphere from the quadratic, inf where missed."""
    a, b = (direction**2).sum(-1), direction @ (origin - centre)
    root = b**2 - a * (np.sum((origin - centre) ** 2) - radius**2)
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


LABELS = np.array([1, 3, 0, 0])  # segmentation of ball, box, table top, room


def expected(camera: Camera, at: Pose) -> tuple[NDArray, NDArray]:
    """Depth in m, and which of ball, box, table top and room (0-3) each pixel shows, from closed
    forms."""
    o, d = rays(camera, at)
    with np.errstate(divide="ignore"):
        inside = np.max([(np.array(corner) - o) / d for corner in ROOM], axis=0).min(-1)
    layers = [
        ball_depth(o, d, RADIUS, BALL_POSE[:3]),
        slab_depth(o, d, HALF, BOX_POSE),
        slab_depth(o, d, np.array([0.6, 0.35, 0.025]), pose((0, 0, 0.715))),
        inside,
    ]
    layers = np.stack(layers)
    return layers.min(0), layers.argmin(0)


@pytest.fixture(scope="module")
def views() -> Iterator[list]:
    wrist = Camera("wrist", KIND, "box", MOUNT)
    with Renderer(BODIES, [], [HEAD, wrist], CLEAN) as renderer:
        yield renderer.render(POSES, depth=True, segmentation=True)


def test_depth_and_segmentation_agree_with_ray_casting(views: list) -> None:
    for view in views:
        depth, shows = expected(view.camera, view.poses[0])
        assert view.depth.dtype == np.uint16 and view.segmentation.dtype == np.uint8
        same = view.segmentation[0] == LABELS[shows]
        assert np.count_nonzero(~same) < 12  # the ball is a polyhedron: its rim may differ
        error = np.abs(view.depth[0] / 1000.0 - depth)
        for layer in (1, 2, 3):
            here = same & (shows == layer)
            # half a millimetre of rounding; a pixel centre on an edge may fall to either side
            assert here.sum() > 200 and np.count_nonzero(error[here] > 0.0006) <= 2
        ball = same & (shows == 0)
        assert ball.sum() > 100 or view.camera.name == "wrist"
        assert not ball.any() or np.median(error[ball]) < 0.0006


def test_box_mask_is_exact_but_for_ties(views: list) -> None:
    _, shows = expected(HEAD, views[0].poses[0])
    assert np.count_nonzero((views[0].segmentation[0] == 3) != (shows == 1)) <= 2


def test_link_mounted_camera_follows_its_link(views: list) -> None:
    assert np.allclose(views[1].poses[0], compose(BOX_POSE, MOUNT))
    drawn = look_of(CLEAN.look).rounded(BOX_POSE)
    fixed = Camera("same", KIND, None, compose(drawn, MOUNT))
    with Renderer(BODIES, [], [fixed], CLEAN) as renderer:
        again = renderer.render(POSES, depth=True, segmentation=True)[0]
    assert np.array_equal(again.rgb, views[1].rgb) and np.array_equal(again.depth, views[1].depth)


def test_masks_do_not_change_the_image_and_frames_are_independent(views: list) -> None:
    two = {name: np.concatenate([p, compose(pose((0.05, 0, 0)), p)]) for name, p in POSES.items()}
    with Renderer(BODIES, [], [HEAD], CLEAN) as renderer:
        plain = renderer.render(two)[0]
        back = renderer.render(two, frames=[1, 0, 1])[0]
    assert plain.depth is None and plain.segmentation is None and plain.rgb.shape == (2, 72, 96, 3)
    assert np.array_equal(plain.rgb[0], views[0].rgb[0])
    assert np.array_equal(back.rgb, plain.rgb[[1, 0, 1]]) and not np.array_equal(
        plain.rgb[0], plain.rgb[1]
    )


HASH = """
import sys, hashlib
from tests.world.drawing import test_renderer as t
print("sha", t.digest())
"""


def digest() -> str:
    """SHA-256 of an image and its masks under randomised visuals."""
    visuals = draw_visuals(np.random.Generator(np.random.Philox(7)))
    with Renderer(BODIES, [], [HEAD], visuals) as renderer:
        view = renderer.render(POSES, depth=True, segmentation=True)[0]
    assert view.depth is not None and view.segmentation is not None
    return hashlib.sha256(
        view.rgb.tobytes() + view.depth.tobytes() + view.segmentation.tobytes()
    ).hexdigest()


def test_same_bytes_again_and_in_another_process_with_more_threads() -> None:
    first = digest()
    assert digest() == first
    threads = os.environ | {"LP_NUM_THREADS": "2"}
    other = subprocess.run(
        [sys.executable, "-c", HASH], capture_output=True, text=True, check=True, env=threads
    )
    assert f"sha {first}" in other.stdout.splitlines()


def test_an_image_depends_on_no_other_camera_frame_or_hidden_body() -> None:
    # more than share one drawing of what keeps still: the ball rests, the box passes through the
    # image and out of it
    frames = 20
    drift = np.zeros((frames, 7))
    drift[:, 0] = np.linspace(-1.5, 1.5, frames)
    poses = {
        "ball": np.repeat(BALL_POSE[None], frames, 0),
        "box": BOX_POSE + drift,
        "nothing": np.repeat(BALL_POSE[None], frames, 0),
    }
    poses["ball"][17:, 2] += 0.1
    wrist = Camera("wrist", KIND, "box", MOUNT)
    with Renderer(BODIES, [], [wrist, HEAD], CLEAN) as renderer:
        together = renderer.render(poses)[1]
    with Renderer(BODIES, [], [HEAD], CLEAN) as renderer:
        alone = [renderer.render(poses, frames=[k])[0].rgb[0] for k in (0, 5, 10, 16, 18, 19)]
    assert np.array_equal(together.rgb[[0, 5, 10, 16, 18, 19]], alone)
    with Renderer(BODIES, [], [HEAD], CLEAN, "raster-fast") as renderer:
        outside = renderer.render(poses, frames=[0])[0].rgb
    with Renderer({**BODIES, "box": []}, [], [HEAD], CLEAN, "raster-fast") as renderer:
        assert np.array_equal(outside, renderer.render(poses, frames=[0])[0].rgb)


def test_an_image_does_not_depend_on_the_renderer_before() -> None:
    def image(preset: str) -> bytes:
        with Renderer(BODIES, [], [HEAD], CLEAN, preset) as renderer:
            return renderer.render(POSES)[0].rgb.tobytes()

    first = dict[str, bytes]()
    # every preset after every one, itself included
    fast = "raster-fast"
    for preset in ("raster", "raster", fast, fast, "raster"):
        drawn = image(preset)
        assert drawn == first.setdefault(preset, drawn)


def test_shadow_darkens_the_table_and_only_with_shadows_on() -> None:
    above = Camera("above", KIND, None, look((0, 0, 1.6), (0, 0.001, -1), (-1, 0, 0)))
    flat = replace(
        CLEAN,
        table=replace(CLEAN.table, pattern="plain"),
        sun_direction=(0.0, 0.6, -1.0),
        points=(),
    )
    bodies, poses = {"ball": BODIES["ball"]}, {"ball": pose((0, 0, 0.95))[None]}
    images = {}
    for preset in ("raster", "raster-fast"):
        with Renderer(bodies, [], [above], flat, preset) as renderer:
            view = renderer.render(poses, segmentation=True)[0]
            images[preset] = view.rgb[0].astype(int).sum(-1)
    # the sun carries the ball's centre 0.6 * 0.21 m along +y on its way to the table
    pixel = intrinsics(KIND) @ extrinsics_cv(above.pose) @ np.array([0, 0.6 * 0.21, 0.74, 1])
    u, v = (pixel[:2] / pixel[2]).astype(int)
    assert images["raster"][v, u] < 0.85 * images["raster-fast"][v, u]
    assert abs(images["raster"][v, 10] - images["raster-fast"][v, 10]) < 6
    assert view.segmentation is not None
    changed = (np.abs(images["raster"] - images["raster-fast"]) > 12) & (view.segmentation[0] == 0)
    # the outermost rows show the floor, with the shadow of the table
    rows, columns = np.nonzero(changed[2:-2])
    assert abs(np.mean(columns) + 0.5 - pixel[0] / pixel[2]) < 3 and abs(np.mean(rows) + 2 - v) < 3


def older_look(number: int) -> NDArray[np.uint8]:
    """An image of a look."""
    visuals = Visuals(
        table=Surface("wood", 12, (0.80, 0.65, 0.47), 0.60),
        wall=Surface("paint", 4, (0.88, 0.87, 0.84), 1.0),
        ground=Surface("plain", 2, (0.52, 0.52, 0.54), 1.0),
        ambient=(0.42, 0.42, 0.43),
        sun_direction=(0.0, 0.5, -1.0),
        sun=(0.52, 0.51, 0.49),
        points=(PointLight((1.0, 0.0, 1.8), (0.26, 0.26, 0.26)),),
        look=number,
    )
    bodies = {
        "ball": [(sphere(RADIUS), Material((0.8, 0.11, 0.1), 0.42))],
        "box": [(box((0, 0, 0), HALF), Material((0.7, 0.7, 0.7), 0.3, 0.8))],
    }
    with Renderer(bodies, [], [HEAD], visuals) as renderer:
        return renderer.render({name: POSES[name] for name in bodies})[0].rgb[0]


@pytest.mark.parametrize(("number", "file"), [(FIRST_LOOK, "first"), (SECOND_LOOK, "second")])
def test_an_episode_of_an_older_look_is_drawn_as_it_was(number: int, file: str) -> None:
    stored = cv2.cvtColor(
        cv2.imread(str(Path(__file__).with_name(f"{file}_look.png"))), cv2.COLOR_BGR2RGB
    )
    # other processors may round otherwise
    assert np.abs(older_look(number).astype(int) - stored).max() <= 2


def test_an_arm_that_trembles_keeps_its_images(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, drawn = 12, list[str]()
    rng = np.random.default_rng(2)
    poses = {name: np.repeat(p, frames, 0) for name, p in POSES.items()}
    poses = {name: look_of(CLEAN.look).rounded(p) for name, p in poses.items()}
    trembling = {name: p + 1e-9 * rng.standard_normal(p.shape) for name, p in poses.items()}
    wrist, take = Camera("wrist", KIND, "box", MOUNT), Renderer._take
    monkeypatch.setattr(
        Renderer, "_take", lambda self, *given: drawn.append("") or take(self, *given)
    )
    images = dict[int, list[NDArray[np.uint8]]]()
    for number, draws in ((LOOK, 2), (THIRD_LOOK, 2), (SECOND_LOOK, 2 * frames)):
        drawn.clear()
        with Renderer(BODIES, [], [wrist, HEAD], replace(CLEAN, look=number)) as renderer:
            images[number] = [view.rgb for view in renderer.render(trembling)]
        assert len(drawn) == draws
    for own, view, exact in zip(*images.values(), strict=True):
        assert (own == own[0]).all() and (view == view[0]).all()
        assert np.abs(view.astype(int) - exact).max() <= 8


def test_our_own_rasteriser_draws_what_the_engine_draws() -> None:
    wrist = Camera("wrist", KIND, "box", MOUNT)
    visuals = draw_visuals(np.random.Generator(np.random.Philox(3)))
    images = dict[int, list[View]]()
    for number in (THIRD_LOOK, LOOK):
        with Renderer(BODIES, [], [HEAD, wrist], replace(visuals, look=number)) as renderer:
            images[number] = renderer.render(POSES, depth=True, segmentation=True)
    for engine, own in zip(*images.values(), strict=True):
        difference = np.abs(engine.rgb.astype(int) - own.rgb).max(-1)
        assert difference.mean() < 3 and (difference > 16).mean() < 0.01
        assert engine.segmentation is not None and own.segmentation is not None
        assert (engine.segmentation != own.segmentation).mean() < 0.002
        assert engine.depth is not None and own.depth is not None
        assert (np.abs(engine.depth.astype(int) - own.depth) > 1).mean() < 0.002


def test_sunlit_brightness_follows_the_cosine_law() -> None:
    """A matt plate under the sun alone: display value squared, below the knee, is albedo x (ambient
    + sun x cosine)."""
    ambient, sun = 0.10, 0.40
    dark = replace(
        CLEAN, ambient=(ambient,) * 3, sun=(sun,) * 3, sun_direction=(0.0, 0.0, -1.0), points=()
    )
    plate = {
        "plate": [(box((0, 0, 0), (0.2, 0.2, 0.005)), Material((0.8, 0.8, 0.8), roughness=1.0))]
    }
    above = Camera(
        "above", CameraType(32, 24, 20.0), None, look((0, 0, 1.8), (0, 0.001, -1), (-1, 0, 0))
    )
    values = []
    with Renderer(plate, [], [above], dark) as renderer:
        for tilt in (0.0, 0.5, 1.0):
            at = pose((0, 0, 1.0), quat_about((0, 1, 0), tilt))
            values.append(renderer.render({"plate": at[None]})[0].rgb[0, 12, 16, 0] / 255.0)
    for tilt, value in zip((0.0, 0.5, 1.0), values, strict=True):
        up = np.cos(tilt)
        radiance = 0.64 * (ambient * (0.75 + 0.25 * up) + sun * up)
        assert value**2 == pytest.approx(radiance, abs=0.03)  # a trace of reflection remains
    assert values[0] > values[1] > values[2]


def test_texture_appears_upright_with_row_zero_at_v_zero() -> None:
    image = np.zeros((64, 64, 4), np.uint8)
    image[..., 3] = 255
    image[:32, :32, 0], image[:32, 32:, 1], image[32:, :32, 2], image[32:, 32:, :3] = (
        230,
        230,
        230,
        230,
    )
    corners = np.array([[0, -0.1, 0.1], [0, 0.1, 0.1], [0, 0.1, -0.1], [0, -0.1, -0.1]], np.float32)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    normals = np.tile(np.array([1, 0, 0], np.float32), (4, 1))
    sign = Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]], np.uint32), normals, uvs)
    front = Camera(
        "front", CameraType(32, 32, 20.0), None, look((1.0, 0, 1.2), (-1, 0, 0), (0, -1, 0))
    )
    with Renderer(
        {"sign": [(sign, Material((1.0, 1.0, 1.0), texture=image))]}, [], [front], CLEAN
    ) as renderer:
        rgb = renderer.render({"sign": pose((0.5, 0, 1.2))[None]})[0].rgb[0].astype(int)
    means = {(r, c): rgb[r, c] for r in (11, 20) for c in (11, 20)}
    assert (
        means[11, 11].argmax() == 0 and means[11, 20].argmax() == 1 and means[20, 11].argmax() == 2
    )
    assert np.ptp(means[20, 20]) < 25 and means[20, 20].min() > 100


def test_clean_image_is_neither_crushed_nor_blown_out(views: list) -> None:
    rgb = views[0].rgb[0]
    assert np.mean(rgb.max(-1) < 15) < 0.01 and np.mean(rgb.min(-1) > 250) < 0.01
    assert 90 < rgb.mean() < 200 and rgb.std() > 15


def test_colour_survives_the_light(views: list) -> None:
    ball = views[0].rgb[0][views[0].segmentation[0] == 1].astype(float).mean(0)
    assert ball[0] > 2 * ball[1] and ball[0] > 2 * ball[2]


def test_ray_traced_image_resembles_the_raster_one(views: list) -> None:
    small = Camera("small", CameraType(24, 18, 45.0), None, HEAD.pose)
    with Renderer(BODIES, [], [small], CLEAN, "rt") as renderer:
        view = renderer.render(POSES, segmentation=True)[0]
    blocks = views[0].rgb[0].reshape(18, 4, 24, 4, 3).mean((1, 3))
    assert view.rgb.std() > 15
    assert np.corrcoef(view.rgb[0].astype(float).ravel(), blocks.ravel())[0, 1] > 0.7
    assert set(np.unique(view.segmentation)) == {0, 1, 3}


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="255"):
        Renderer({f"b{i}": [] for i in range(256)}, [], [HEAD], CLEAN)
    with Renderer(BODIES, [], [HEAD], CLEAN) as renderer, pytest.raises(KeyError, match="ball"):
        renderer.render({"box": POSES["box"]})


def test_depth_buffer_inverts_the_projection() -> None:
    z = np.linspace(0.05, 8.0, 400)
    buffer = FAR * (z - NEAR) / (z * (FAR - NEAR))
    assert np.abs(millimetres(buffer.astype(np.float32)) - z * 1000).max() < 0.6 + 0.4
    assert millimetres(np.ones((1, 1), np.float32))[0, 0] == 0
    assert linear(0.5) == pytest.approx(0.21404, abs=1e-5)


def test_renderers_come_and_go_without_leaking() -> None:
    def resident() -> float:
        with open("/proc/self/statm") as f:
            return int(f.read().split()[1]) * 4096 / 2**20

    sizes = []
    for i in range(9):
        with Renderer(
            BODIES, [], [HEAD], draw_visuals(np.random.Generator(np.random.Philox(i)))
        ) as renderer:
            renderer.render(POSES)
        sizes.append(resident())
    assert sizes[-1] - sizes[3] < 12  # MiB over 5 renderers


def test_a_camera_that_sees_nothing_move_takes_no_other_image(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # looks at the table beside the box; the shadow of the box crosses what it sees in some frames
    beside = Camera("beside", KIND, None, look((0.35, 0.0, 1.0), (0.0, 0.05, -1.0)))
    frames = 24
    poses = {name: np.repeat(at, frames, 0) for name, at in POSES.items()}
    poses["box"][:, 0] = np.linspace(-0.5, 0.05, frames)
    poses["box"][:, 2] = 0.95
    poses["ball"] += np.random.default_rng(0).uniform(-1e-17, 1e-17, (frames, 7))
    taken = list[str]()
    take = Renderer._take
    monkeypatch.setattr(
        Renderer, "_take", lambda self, *given: taken.append("") or take(self, *given)
    )
    with Renderer(BODIES, [], [beside], CLEAN) as renderer:
        together = renderer.render(poses, depth=True)[0]
        assert 1 < len(taken) < frames - 4
        for k in range(frames):
            alone = renderer.render(poses, frames=[k], depth=True)[0]
            assert np.array_equal(alone.rgb[0], together.rgb[k])
            assert np.array_equal(alone.depth[0], together.depth[k])
    assert len(np.unique(together.rgb, axis=0)) > 2
