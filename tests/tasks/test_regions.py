"""Where bodies may stand, against numbers written down from the original's code (RoboTwin 2.0 and
DOMINO, dynamic versions)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from pipeline.data.cameras import visible
from pipeline.data.spec import EpisodeSpec
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS, lay_out
from pipeline.tasks.contract import Draw
from pipeline.world.cameras import cameras_of
from pipeline.world.robots import get_embodiment

LAYOUTS = 60


@dataclass(frozen=True)
class Interval:
    """Positions of one body: |x| or x, y (m) and yaw (rad) as the original draws them; `yaw` None
    is not compared.

    `covered` is the share of each interval that the drawn layouts must span.
    """

    task: str
    body: str
    x: tuple[float, float]
    y: tuple[float, float]
    yaw: tuple[float, float] | None = None
    mirrored: bool = False
    covered: float = 0.85


ORIGINAL = (
    Interval("grab_roller", "roller", (-0.15, 0.15), (-0.25, -0.05), (-0.8, 0.8)),
    Interval("handover_block", "block", (-0.25, -0.05), (0.0, 0.25), (-0.2, 0.2)),
    Interval("handover_block", "pad", (0.10, 0.25), (0.15, 0.20)),
    Interval("hanging_mug", "mug", (-0.25, -0.10), (-0.05, 0.05), (-1.57, 1.57)),
    Interval("hanging_mug", "rack", (0.10, 0.30), (0.13, 0.17), (-0.2, 0.2)),
    Interval("put_bottles_dustbin", "bottle", (-0.25, 0.30), (0.03, 0.23)),
    Interval("dump_bin_bigbin", "bin", (0.05, 0.20), (-0.20, -0.05), (-0.37, 0.37), mirrored=True),
    Interval("put_object_cabinet", "cabinet", (-0.05, 0.05), (0.155, 0.155), (0.0, 0.0)),
    Interval(
        "move_can_pot",
        "can",
        (0.26, 0.30),
        (0.05, 0.15),
        (-0.79, 0.79),
        mirrored=True,
        covered=0.75,
    ),
    Interval("move_can_pot", "pot", (0.0, 0.0), (0.0, 0.0), (-0.393, 0.393)),
    Interval("beat_block_hammer", "block", (-0.25, 0.25), (-0.05, 0.15), (-0.5, 0.5)),
    Interval("adjust_bottle", "bottle", (0.08, 0.12), (-0.13, -0.08), mirrored=True),
    Interval("shake_bottle", "bottle", (-0.25, 0.25), (-0.20, -0.05), (-0.79, 0.79)),
    Interval("shake_bottle_horizontally", "bottle", (-0.20, 0.20), (-0.15, -0.05), (-0.79, 0.79)),
    Interval(
        "move_playingcard_away", "cards", (0.05, 0.10), (-0.20, 0.05), (-3.15, 3.15), mirrored=True
    ),
    Interval("rotate_qrcode", "sign", (0.05, 0.20), (-0.20, 0.0), (-0.7, 0.7), mirrored=True),
    Interval("click_bell", "bell", (0.05, 0.21), (-0.20, 0.10), (0.0, 0.0), mirrored=True),
    Interval(
        "click_alarmclock", "clock", (0.05, 0.21), (-0.20, 0.10), (-3.15, 3.15), mirrored=True
    ),
    Interval("press_stapler", "stapler", (-0.20, 0.20), (-0.10, 0.05), (-3.15, 3.15)),
    Interval(
        "scan_object",
        "scanner",
        (0.05, 0.25),
        (-0.15, -0.05),
        (np.pi - 1.2, np.pi + 1.2),
        mirrored=True,
    ),
    Interval("scan_object", "box", (0.05, 0.25), (-0.20, 0.0), (-1.2, 1.2), mirrored=True),
    Interval(
        "place_object_basket", "object", (0.20, 0.25), (-0.10, 0.10), (-0.53, 0.53), mirrored=True
    ),
    Interval("place_object_basket", "basket", (0.02, 0.02), (-0.08, -0.05), mirrored=True),
)

CUT_BY_THE_CAMERA = (
    Interval("handover_mic", "microphone", (0.20, 0.30), (-0.15, 0.05), mirrored=True),
    Interval(
        "put_object_cabinet", "object", (0.20, 0.32), (-0.20, -0.10), (-1.05, 1.05), mirrored=True
    ),
)
"""Targets whose region reaches beyond the right border of the head camera's image: the left side is
compared."""


def drawn(task: str) -> list[dict[str, np.ndarray]]:
    """Poses (7,) of the bodies by name in many layouts that the head camera of the Aloha sees."""
    head = cameras_of(get_embodiment("aloha-agilex"))[0]
    rngs = (
        (np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1]))
        for seed in range(LAYOUTS)
    )
    layouts = (
        lay_out(
            TASKS[task], Draw(a, b), lambda point: bool(visible(head.type, head.pose, point, 4.0))
        )
        for a, b in rngs
    )
    return [{name: body.pose for name, body in bodies.items()} for bodies in layouts]


@pytest.fixture(scope="module")
def layouts():
    return cache(drawn)


def spans(values: np.ndarray, interval: tuple[float, float], share: float, what: str) -> None:
    """Assert that values lie in an interval and span a share of it."""
    low, high = interval
    assert low - 1e-9 <= values.min(), f"{what} {values.min():.3f} below {low}"
    assert values.max() <= high + 1e-9, f"{what} {values.max():.3f} above {high}"
    assert np.ptp(values) >= share * (high - low), (
        f"{what} spans {values.min():.3f} to {values.max():.3f} of {interval}"
    )


def compare(want: Interval, poses: np.ndarray) -> None:
    what = f"{want.task}: {want.body}"
    spans(np.abs(poses[:, 0]) if want.mirrored else poses[:, 0], want.x, want.covered, f"{what} x")
    spans(poses[:, 1], want.y, want.covered, f"{what} y")
    if want.yaw is not None:
        middle = sum(want.yaw) / 2
        yaw = 2 * np.arctan2(poses[:, 6], poses[:, 3])
        # turned alike on both sides
        groups = (yaw[poses[:, 0] < 0], yaw[poses[:, 0] > 0]) if want.mirrored else (yaw,)
        for side in filter(len, groups):
            spans(
                middle + (side - middle + np.pi) % (2 * np.pi) - np.pi,
                want.yaw,
                want.covered,
                f"{what} yaw",
            )


@pytest.mark.parametrize("want", ORIGINAL, ids=lambda want: f"{want.task}-{want.body}")
def test_a_body_stands_wherever_the_original_puts_it_and_nowhere_else(want, layouts):
    poses = np.array([bodies[want.body] for bodies in layouts(want.task)])
    compare(want, poses)
    if want.mirrored:
        assert 0.35 < np.mean(poses[:, 0] < 0) < 0.65, "both sides are drawn alike"


@pytest.mark.parametrize("want", CUT_BY_THE_CAMERA, ids=lambda want: f"{want.task}-{want.body}")
def test_a_region_that_the_camera_cuts_is_whole_on_the_left(want, layouts):
    poses = np.array([bodies[want.body] for bodies in layouts(want.task)])
    compare(want, poses[poses[:, 0] < 0])
    right = poses[poses[:, 0] > 0]
    assert want.x[0] <= right[:, 0].min()
    assert 0.24 < right[:, 0].max() < want.x[1], (
        "seen up to 25 cm or so, as the camera stands 3 cm left of the middle"
    )


def test_the_can_keeps_the_original_distance_from_the_pot(layouts):
    for bodies in layouts("move_can_pot"):
        assert np.hypot(*(bodies["can"][:2] - bodies["pot"][:2])) >= 0.30


def test_a_mug_near_the_middle_stands_near_the_robot(layouts):
    mugs = np.array([bodies["mug"] for bodies in layouts("hanging_mug")])
    near = np.abs(mugs[:, 0]) < 0.15
    assert mugs[near, 1].max() <= 0.0
    assert mugs[~near, 1].max() > 0.03


def test_a_bottle_for_the_dustbin_keeps_out_of_the_middle(layouts):
    assert min(abs(bodies["bottle"][0]) for bodies in layouts("put_bottles_dustbin")) >= 0.05


def test_the_block_stands_in_the_middle_too(layouts):
    blocks = np.array([bodies["block"] for bodies in layouts("beat_block_hammer")])
    near = np.abs(blocks[:, 0]) < 0.05
    assert 0.06 < near.mean() < 0.25, (
        "0.2 in the original, whose block may stand where ours would touch the hammer"
    )
    assert np.ptp(blocks[near, 0]) > 0.05


def test_the_basket_stands_away_from_the_arm(layouts):
    for bodies in layouts("place_object_basket"):
        assert bodies["basket"][0] * bodies["object"][0] < 0


def test_the_block_has_the_size_of_the_original():
    block = (
        build_scene(EpisodeSpec("handover_block", "aloha-agilex", 0, 0.0, "clean", 0, 0))
        .bodies["block"]
        .instance
    )
    np.testing.assert_allclose(np.ptp(block.shape().aabb(), axis=0), (0.06, 0.06, 0.20), atol=1e-9)


def test_the_cabinet_is_filled_with_ten_kinds_of_objects():
    seen = set()
    for seed in range(120):
        rngs = np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])
        seen.add(lay_out(TASKS["put_object_cabinet"], Draw(*rngs))["object"].family)
    original = {
        "mouse",
        "stapler",
        "toy_car",
        "rubiks_cube",
        "bread",
        "phone",
        "playing_cards",
        "tea_box",
        "coffee_box",
        "soap",
    }
    assert seen == original
