"""Things that are made for each other fit: phone and stand, mug and rack, drawer and cabinet, what
goes into what."""

import numpy as np
import pytest
import sapien

from pipeline.poses import compose, frame, inverse, pose, quat_rotate, transform
from pipeline.tasks.library.domino.set_down.place_phone_stand import GAP
from pipeline.world.objects import FAMILIES
from pipeline.world.objects.families.containers.cabinet import Cabinet
from tests.world.objects.test_families import add, rng

SEEDS = range(6)


def world() -> sapien.Scene:
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 240)
    scene.add_ground(0, render=False)
    return scene


def placed(scene, shape, at):
    entity = add(scene, shape, np.asarray(at[:3]))
    entity.set_pose(sapien.Pose(at[:3], at[3:]))
    return entity


@pytest.mark.parametrize("seed", SEEDS)
def test_a_phone_rests_on_its_stand(seed):
    stand, phone = FAMILIES["phone_stand"].draw(rng(seed)), FAMILIES["phone"].draw(rng(seed + 100))
    start = compose(stand.frames()["seat"], inverse(phone.frames()["foot"]))
    start[:3] += 0.001 * quat_rotate(stand.frames()["seat"][3:], (0, 0, 1))
    scene = world()
    add(scene, stand.shape(), np.zeros(3))
    entity = placed(scene, phone.shape(), start)
    for _ in range(240):
        scene.step()
    assert np.linalg.norm(entity.pose.p - start[:3]) < 0.008
    assert quat_rotate(entity.pose.q, (0, 1, 0))[2] > 0.8


@pytest.mark.parametrize("seed", SEEDS)
def test_a_phone_that_comes_down_onto_a_moving_stand_does_not_touch_it_before(seed):
    """The phone comes down at 0.2 m/s, the stand moves along y, where lip and back rest are in the
    way."""
    stand, phone = FAMILIES["phone_stand"].draw(rng(seed)), FAMILIES["phone"].draw(rng(seed + 100))
    goal = compose(
        compose(stand.frames()["seat"], pose((0, 0, GAP))), inverse(phone.frames()["foot"])
    )
    low, high = phone.shape().aabb()
    grid = np.stack(
        np.meshgrid([low[0], 0, high[0]], *np.linspace(low[1:], high[1:], 60).T, indexing="ij"), -1
    ).reshape(-1, 3)
    for early in np.linspace(0.01, 0.3, 30):  # s
        for speed in (0.08, 0.0, -0.12):
            points = transform(goal, grid) + np.array([0, speed, 0.2]) * early
            for half, centre, turn in stand.boxes():
                inside = np.abs(transform(inverse(pose(centre, turn)), points)) < half
                assert not inside.all(1).any(), f"{1000 * early:.0f} ms too early at {speed} m/s"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_mug_hangs_on_the_rack(seed):
    rack, mug = FAMILIES["rack"].draw(rng(seed)), FAMILIES["mug"].draw(rng(seed + 100))
    hole = mug.frames()["handle_hole"]
    # the hole's axis goes along the peg, the mug hangs below it: its x axis (towards the ear)
    # points up
    along = rack.frames()["peg_middle"]
    z = quat_rotate(along[3:], (0, 0, 1))
    x = np.array([0, 0, 1.0]) - z * z[2]
    hung = frame(along[:3] - 0.006 * x, x, np.cross(z, x))
    grip = frame(hole[:3], (1, 0, 0), np.cross(quat_rotate(hole[3:], (0, 0, 1)), (1, 0, 0)))
    start = compose(hung, inverse(grip))
    scene = world()
    add(scene, rack.shape(), np.zeros(3))
    entity = placed(scene, mug.shape(), start)
    for _ in range(360):
        scene.step()
    hole_now = entity.pose.p + quat_rotate(entity.pose.q, hole[:3])
    assert hole_now[2] > 0.6 * rack.height
    assert np.linalg.norm(hole_now - along[:3]) < 0.06


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drawer_slides_in_its_cabinet(seed):
    cabinet = Cabinet.draw(rng(seed))
    drawer, slide = cabinet.drawer(), cabinet.slide()
    assert slide.axis == (0.0, -1.0, 0.0)
    assert 0.5 * 2 * drawer.hy < slide.upper < 2 * drawer.hy
    for travel in np.linspace(slide.lower, slide.upper, 5):
        shift = cabinet.slot()[:3] + travel * np.array(slide.axis)
        for piece in drawer.shape().collision:
            low, high = piece.support_points().min(0) + shift, piece.support_points().max(0) + shift
            for half, centre in cabinet.boards():
                apart = np.maximum(np.subtract(centre, half) - high, low - np.add(centre, half))
                assert apart.max() > 0.0005, (piece.kind, half)
    front = drawer.shape().aabb()[1, 2] - drawer.shape().aabb()[0, 2]
    assert front > 0.9 * cabinet.bay


def inner_half(name: str, seed: int) -> np.ndarray:
    """Half extents (2,) of the free floor of a hollow rectangular thing."""
    one = FAMILIES[name].draw(rng(seed))
    return np.array([one.hx, one.hy]) - 0.006


@pytest.mark.parametrize("seed", SEEDS)
def test_what_goes_into_baskets_fits(seed):
    basket, other = inner_half("basket", seed), rng(seed + 50)
    arch = FAMILIES["basket"].draw(rng(seed)).grip
    for name in ("can", "toy_car", "playing_cards"):
        size = np.ptp(FAMILIES[name].draw(other).shape().aabb(), axis=0)[:2]
        short, long = np.sort(size)
        assert short < basket[0] - arch
        assert long < 2 * basket[1]
    bread = np.ptp(FAMILIES["bread"].draw(other).shape().aabb(), axis=0)
    tray = inner_half("bread_basket", seed)
    assert bread[0] < 2 * tray[0]
    assert bread[1] < 2 * tray[1]


ON_TOP = (
    ("cup", "coaster"),
    ("bell", "display_stand"),
    ("rubiks_cube", "display_stand"),
    ("mouse", "scale"),
    ("bell", "scale"),
    ("bread", "skillet"),
    ("bowl", "plate"),
    ("block", "pad"),
)


@pytest.mark.parametrize(("small", "large"), ON_TOP)
def test_what_is_set_on_something_fits_on_it(small, large):
    for seed in SEEDS:
        base = FAMILIES[small].draw(rng(seed)).shape()
        goal = FAMILIES[large].draw(rng(seed + 7))
        foot = np.concatenate([c.support_points() for c in base.collision])
        foot = foot[foot[:, 2] < 0.01]
        room = goal.shape().aabb()[1, :2].min() if large != "skillet" else 0.82 * goal.radius * 1.35
        assert np.abs(foot[:, :2]).max(0).min() < room


def test_faces_look_out_of_their_objects():
    for name, point in (
        ("seal", "stamp"),
        ("qr_sign", "code"),
        ("scanner", "window"),
        ("tea_box", "left"),
        ("fan", "front"),
    ):
        one = FAMILIES[name].draw(rng(0))
        p = one.frames()[point]
        out = quat_rotate(p[3:], (0, 0, 1))
        lower, upper = one.shape().aabb()
        beyond = p[:3] + 0.3 * out
        assert np.any((beyond < lower) | (beyond > upper))
        centre = (lower + upper) / 2
        assert (p[:3] - centre) @ out > 0
