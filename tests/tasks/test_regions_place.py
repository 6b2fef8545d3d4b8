"""The regions of the placing tasks against the original's, written down from its code: dynamic ones
where it has two."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.stats import ks_2samp

from pipeline.tasks import TASKS, lay_out
from pipeline.tasks.contract import Draw
from pipeline.world.objects import FAMILIES

LAYOUTS = 200
ROUNDING = 1e-9


@dataclass(frozen=True)
class Original:
    """x and y (m) of a body and the largest yaw (rad). With `beside`, x counts away from x = 0 on
    the side where that body stands.

    Bodies that are round about the vertical stand in the original one way and here any way.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    yaw: float = 0.0
    beside: str = ""


PI = float(np.pi)
REGIONS: dict[str, dict[str, Original]] = {
    "move_pillbottle_pad": {
        "bottle": Original((0.05, 0.25), (-0.1, 0.1), PI, "bottle"),
        "pad": Original((0.05, 0.25), (-0.2, 0.1), 0, "bottle"),
    },
    "move_stapler_pad": {
        "stapler": Original((0.05, 0.25), (-0.2, 0), PI, "stapler"),
        "pad": Original((0.05, 0.25), (-0.2, 0), 0, "stapler"),
    },
    "place_a2b_left": {"a": Original((-0.22, 0.22), (-0.2, 0), PI)},
    "place_a2b_right": {"a": Original((-0.22, 0.22), (-0.2, 0), PI)},
    "place_bread_basket": {
        "bread": Original((0.15, 0.27), (-0.2, 0.05), PI / 4, "bread"),
        "basket": Original((-0.25, 0.25), (-0.05, 0.15), PI),
    },
    "place_bread_skillet": {
        "bread": Original((0.2, 0.28), (-0.2, 0.05), PI / 4, "bread"),
        # y from -0.2 in the original; nearer than -0.12 our handle would reach over the edge of the
        # table
        "skillet": Original((-0.25, -0.15), (-0.12, 0.05), PI / 6, "bread"),
    },
    "place_can_basket": {
        "basket": Original((-0.02, 0.02), (-0.08, -0.05)),
        "can": Original((0.2, 0.25), (0, 0.1), PI, "can"),
    },
    "place_container_plate": {
        "container": Original((0.2, 0.28), (-0.1, 0.05), PI, "container"),
        "plate": Original((0.02, 0.08), (-0.15, -0.1), 0, "container"),
    },
    "place_empty_cup": {
        "cup": Original((0.15, 0.3), (-0.2, 0.05), PI, "cup"),
        "coaster": Original((-0.05, 0.1), (-0.2, 0.05), 0, "cup"),
    },
    "place_fan": {
        "fan": Original((-0.1, 0.1), (-0.15, -0.05), PI),
        "pad": Original((-0.25, 0.25), (-0.2, 0)),
    },
    "place_mouse_pad": {
        "mouse": Original((0.05, 0.25), (-0.2, 0), PI, "mouse"),
        "pad": Original((0.05, 0.25), (-0.2, 0), 0, "mouse"),
    },
    "place_object_scale": {
        "object": Original((0.02, 0.25), (-0.2, 0.05), PI, "object"),
        "scale": Original((0.02, 0.25), (-0.2, 0.05), PI, "object"),
    },
    "place_object_stand": {
        "object": Original((0.2, 0.28), (-0.05, 0.05), PI / 3, "object"),
        "stand": Original((0, 0.05), (-0.15, -0.1), PI / 6, "object"),
    },
    "place_phone_stand": {
        "phone": Original((0.05, 0.25), (-0.2, 0), 0.7, "phone"),
        "stand": Original((0, 0.15), (0, 0.2), 0, "phone"),
    },
    "place_shoe": {
        "shoe": Original((0.229, 0.25), (-0.1, 0.05), PI, "shoe"),
        "mat": Original((-0.2, 0.2), (-0.15, -0.05)),
    },
    "stamp_seal": {
        "stamp": Original((0, 0), (0, 0), PI),
        "pad": Original((-0.25, 0.25), (-0.15, 0.15)),
    },
}


LEAST = {
    "move_pillbottle_pad": ("bottle", "pad", 0.1),
    "move_stapler_pad": ("stapler", "pad", 0.1),
    "place_bread_basket": ("bread", "basket", 0.1),
    "place_empty_cup": ("cup", "coaster", 0.1),
    "place_mouse_pad": ("mouse", "pad", 0.1),
    "place_object_scale": ("object", "scale", 0.15),
    "place_object_stand": ("object", "stand", 0.1),
    "place_phone_stand": ("phone", "stand", 0.15),
}
"""Least distances (m) between two bodies, seen from above."""


@pytest.fixture(scope="module", autouse=True)
def shapes_made_once():
    """The same few instances are drawn again and again: their shapes, most of the time a layout
    takes, are made once."""
    with pytest.MonkeyPatch.context() as patch:
        for family in set(FAMILIES.values()):
            patch.setattr(family, "shape", cache(family.shape))
        yield


def layouts(task, count):
    """Layouts of a task, without physics: four sets of instances, each time at other places."""
    placement = np.random.default_rng(7)
    return [
        lay_out(TASKS[task], Draw(np.random.default_rng(k % 4), placement)) for k in range(count)
    ]


@pytest.fixture(scope="module", params=sorted(REGIONS))
def drawn(request):
    """A task's name and, by body, LAYOUTS rows of x, y, yaw, as they are drawn without physics."""
    bodies = layouts(request.param, LAYOUTS)
    rows = {
        n: np.array([[*b[n].pose[:2], 2 * np.arctan2(b[n].pose[6], b[n].pose[3])] for b in bodies])
        for n in bodies[0]
    }
    for values in rows.values():
        values[:, 2] = (values[:, 2] + PI) % (2 * PI) - PI
    return request.param, rows


def told(rows, name, original):
    """The rows of a body with x as the original tells it."""
    values = rows[name].copy()
    if original.beside:
        values[:, 0] *= np.where(rows[original.beside][:, 0] < 0, -1, 1)
    return values


def test_bodies_stand_in_the_original_s_regions_and_fill_them(drawn):
    task, rows = drawn
    for name, original in REGIONS[task].items():
        values = told(rows, name, original)
        for k, (low, high) in enumerate((original.x, original.y, (-original.yaw, original.yaw))):
            column = values[:, k]
            assert column.min() >= low - ROUNDING, f"{task}: {name} column {k}"
            assert column.max() <= high + ROUNDING, f"{task}: {name} column {k}"
            assert np.ptp(column) >= 0.75 * (high - low), f"{task}: {name} column {k} is not filled"


def test_bodies_keep_the_original_s_least_distances(drawn):
    task, rows = drawn
    if task in LEAST:
        a, b, least = LEAST[task]
        assert np.hypot(*(rows[a] - rows[b])[:, :2].T).min() >= least


def test_both_halves_of_the_table_are_used_alike(drawn):
    task, rows = drawn
    side = rows[TASKS[task].manipulated if task != "stamp_seal" else "pad"][:, 0] > 0
    assert 0.35 < side.mean() < 0.65


def test_where_the_original_keeps_a_distance_from_the_middle():
    for task, body, least in (("place_shoe", "shoe", 0.25), ("stamp_seal", "pad", 0.1)):
        distances = [np.hypot(*bodies[body].pose[:2]) for bodies in layouts(task, LAYOUTS)]
        assert least <= min(distances) < least + 0.02


@pytest.mark.parametrize(("task", "direction"), [("place_a2b_left", -1), ("place_a2b_right", 1)])
def test_b_leaves_room_on_the_side_a_shall_come_to(task, direction):
    """B: beyond the goal on A's half, or in the middle; 10 cm in y from A, and A not yet near it on
    that side."""
    for bodies in layouts(task, LAYOUTS):
        a, b = bodies["a"].pose[:2], bodies["b"].pose[:2]
        side = 1 if a[0] > 0 else -1
        assert (abs(b[0]) <= 0.1) if side == direction else (0.18 <= side * b[0] <= 0.23)
        assert -0.2 <= b[1] <= 0.0
        assert abs(a[1] - b[1]) >= 0.1 - ROUNDING
        assert direction * (a[0] - b[0]) < 0 or np.hypot(*(a - b)) > 0.19


def original_pairs(rng, direction, count):
    """Positions (N,2) of A and B by rejection, as the original draws them: B again until it is 10
    cm from A in y, then both."""
    a, b = (
        rng.uniform((-0.22, -0.2), (0.22, 0), (count, 2)),
        rng.uniform((0, -0.2), (1, 0), (200, count, 2)),
    )
    side = np.where(a[:, 0] > 0, 1, -1)
    low, high = (
        np.where(side == direction, -0.1, side * 0.205 - 0.025),
        np.where(side == direction, 0.1, side * 0.205 + 0.025),
    )
    first = np.argmax(np.abs(b[..., 1] - a[:, 1]) >= 0.1, axis=0)
    b = b[first, np.arange(count)]
    b[:, 0] = low + b[:, 0] * (high - low)
    kept = (direction * (a[:, 0] - b[:, 0]) < 0) | (np.hypot(*(a - b).T) > 0.19)
    return a[kept], b[kept]


@pytest.mark.parametrize(("task", "direction"), [("place_a2b_left", -1), ("place_a2b_right", 1)])
def test_a_and_b_stand_as_often_near_and_far_as_in_the_original(task, direction):
    a, b = original_pairs(np.random.default_rng(0), direction, 4000)
    draw = Draw(np.random.default_rng(1), np.random.default_rng(2))
    ours = np.array([TASKS[task].places(draw) for _ in range(2000)])
    for theirs, mine in ((a, ours[:, 0]), (b, ours[:, 1])):
        for axis in (0, 1):
            assert ks_2samp(theirs[:, axis], mine[:, axis]).pvalue > 0.001
