"""Every registered family against its contract: determinism, geometry, grasps that hold material,
words, rest, hollowness."""

import re
from collections.abc import Sequence
from dataclasses import astuple
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import sapien

from pipeline.poses import quat_rotate
from pipeline.world.looks.materials import PALETTE, WOODS
from pipeline.world.objects import FAMILIES, Family
from pipeline.world.shapes import Shape
from tests.world.drawing.coplanar import coplanar
from tests.world.objects.rays import Line, merged, prepare

NAMES = sorted(FAMILIES)
TRIANGLES = 800
HOLLOW = {
    "bowl",
    "cup",
    "mug",
    "pot",
    "skillet",
    "basket",
    "bread_basket",
    "table_bin",
    "big_bin",
    "dustbin",
    "drawer",
}


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


@cache
def drawn(name: str) -> list[Family]:
    return [FAMILIES[name].draw(rng(seed)) for seed in range(20)]


@cache
def built(name: str) -> list[tuple[Family, Shape]]:
    return [(d, d.shape()) for d in drawn(name)[:5]]


@pytest.mark.parametrize("name", NAMES)
def test_drawing_is_deterministic_and_varied(name):
    assert drawn(name) == [FAMILIES[name].draw(rng(seed)) for seed in range(20)]
    assert len({astuple(d) for d in drawn(name)}) == 20
    sizes = np.array([[v for v in astuple(d) if isinstance(v, float)] for d in drawn(name)])
    assert np.sum(np.ptp(sizes, axis=0) > 1e-4) >= 2


@pytest.mark.parametrize("name", NAMES)
def test_no_two_parts_share_a_visible_plane(name):
    assert not any(coplanar([(name, shape.visual)]) for _, shape in built(name))


@pytest.mark.parametrize("name", NAMES)
def test_shapes_are_a_function_of_the_parameters(name):
    one, shape = built(name)[0]
    again = type(one).shape.__wrapped__(one)  # past the memory of the latest instances
    assert again is not shape
    for (mesh, skin), (other_mesh, other_skin) in zip(shape.visual, again.visual, strict=True):
        assert np.array_equal(mesh.vertices, other_mesh.vertices)
        assert np.array_equal(mesh.triangles, other_mesh.triangles)
        assert skin.color == other_skin.color
        assert (skin.texture is None) == (other_skin.texture is None)
        assert skin.texture is None or np.array_equal(skin.texture, other_skin.texture)
    assert all(
        np.array_equal(a.pose, b.pose) and a.size == b.size
        for a, b in zip(shape.collision, again.collision, strict=True)
    )


@pytest.mark.parametrize("name", NAMES)
def test_visual_and_collision_agree_and_stand_on_the_ground(name):
    for one, shape in built(name):
        points = np.concatenate([m.vertices for m, _ in shape.visual])
        seen = np.stack([points.min(0), points.max(0)])
        solid = shape.aabb()
        # the bounds of turned cylinders are boxes' bounds
        if any(c.kind == "cylinder" for c in shape.collision):
            assert np.all(seen[0] - solid[0] > -0.004)
            assert np.all(solid[1] - seen[1] > -0.004)
        assert np.abs(seen - solid).max() < 0.009, (one, seen, solid)
        assert abs(seen[0, 2]) < 1e-3
        assert solid[0, 2] == pytest.approx(0, abs=1.5e-3)
        assert 0.001 < shape.mass < 12
        assert 0.2 < shape.friction <= 1.0


@pytest.mark.parametrize("name", NAMES)
def test_meshes_are_light_and_well_formed(name):
    for _, shape in built(name):
        assert sum(len(m.triangles) for m, _ in shape.visual) <= TRIANGLES
        for mesh, material in shape.visual:
            assert np.isfinite(mesh.vertices).all()
            assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1, abs=1e-4)
            assert mesh.triangles.max() < len(mesh.vertices)
            assert material.texture is None or mesh.uvs is not None


@pytest.mark.parametrize("name", NAMES)
def test_frames_lie_on_the_object(name):
    for one, shape in built(name):
        frames = one.frames()
        assert frames["base"] == pytest.approx([0, 0, 0, 1, 0, 0, 0], abs=1e-9)
        assert frames["top"][2] == pytest.approx(shape.aabb()[1, 2], abs=0.009)
        lower, upper = shape.aabb()
        for label, p in frames.points.items():
            assert np.linalg.norm(p[3:]) == pytest.approx(1, abs=1e-9)
            assert np.all((p[:3] > lower - 0.01) & (p[:3] < upper + 0.01)), label
        with pytest.raises(KeyError, match="no frame"):
            frames["nowhere"]


@pytest.mark.parametrize("name", NAMES)
def test_grasps_hold_material_with_room_for_the_fingers(name):
    """Along the opening direction, at the tcp or up to 12 mm ahead (inside the pads), material ends
    at +-width/2, then air."""
    for one, shape in built(name)[:2]:
        grasps = one.frames().grasps
        chosen = rng(5).permutation(len(grasps))[:30]
        lines = prepare(shape.collision)
        for g in (grasps[k] for k in chosen):
            assert 0 < g.width <= 0.075
            approach, opening = quat_rotate(g.pose[3:], np.eye(3)[:2])
            assert any(
                _held(lines, g.pose[:3] + ahead * approach, opening, g.width)
                for ahead in (0, 0.004, 0.008, 0.012)
            ), (drawn, g)


def _held(lines: Sequence[Line], at: np.ndarray, opening: np.ndarray, width: float) -> bool:
    spans = merged([s for line in lines if (s := line(at, opening))])
    near = [s for s in spans if s[0] < width / 2 + 0.01 and s[1] > -width / 2 - 0.01]
    return (
        bool(near) and abs(near[0][0] + width / 2) < 0.003 and abs(near[-1][1] - width / 2) < 0.003
    )


def test_a_pinch_beside_the_object_or_of_the_wrong_width_would_be_noticed():
    _, shape = built("block")[0]
    lines, side = prepare(shape.collision), shape.aabb()[1, 2]
    middle, y = np.array([0, 0, side / 2]), np.array([0.0, 1, 0])
    assert _held(lines, middle, y, side)
    assert not _held(lines, middle, y, side - 0.01)
    assert not _held(lines, middle, y, side + 0.01)
    assert not _held(lines, np.array([0.1, 0, side / 2]), y, side)
    assert not _held(lines, np.array([0, 0.01, side / 2]), y, side)


@pytest.mark.parametrize("name", NAMES)
def test_words_are_true_and_plenty(name):
    for one in drawn(name):
        words = one.words()
        assert (len(words.seen), len(words.unseen)) == (12, 3)
        assert len(set(words.seen) | set(words.unseen)) == len(words.seen) + len(words.unseen)
        assert words.noun in words.seen
        assert all(
            p == p.strip() and "{" not in p and not p.lower().startswith(("a ", "the "))
            for p in words.seen + words.unseen
        )
        own = {v for v in astuple(one) if isinstance(v, str)} | {"wooden"}
        named = {c for c in (*PALETTE, *WOODS) for p in words.seen if f" {c} " in f" {p} "}
        compound = {part for v in own for part in v.split()} | own
        assert named <= compound, (named - compound, one)


SIZES = [("small", "large"), ("short", "tall"), ("short", "long"), ("narrow", "wide"), ("low", "tall"), ("thin", "thick"),  # noqa: E501
         ("slim", "thick")]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_words_of_size_follow_a_measure_of_the_object(name):
    """Some parameter of the family (or the area hx times hy) separates the instances that are
    called small, medium-sized, large."""
    called: dict[str, list[dict[str, float]]] = {}
    ones = [FAMILIES[name].draw(rng(seed)) for seed in range(60)]
    first = [{phrase.split()[0] for phrase in one.words().seen} for one in ones]
    for one, said in zip(ones, first, strict=True):
        values = {k: v for k, v in vars(one).items() if isinstance(v, float)}
        values["area"] = values.get("hx", 1.0) * values.get("hy", 1.0)
        size = (said - set.intersection(*first)) & {
            word for pair in SIZES for word in (*pair, "medium-sized")
        }
        called.setdefault(min(size) if len(size) == 1 else "", []).append(values)
    if set(called) == {""}:
        assert name in ("drawer", "long_block")  # one size
        return
    least, most = next(pair for pair in SIZES if {*pair, "medium-sized"} >= set(called))
    order = [called[word] for word in (least, "medium-sized", most) if word in called]
    assert len(order) >= 2
    assert any(
        all(max(v[key] for v in low) <= min(v[key] for v in high) for low, high in pairwise(order))
        for key in order[0][0]
    ), name


@pytest.mark.parametrize("name", [n for n in NAMES if hasattr(drawn(n)[0], "form")])
def test_words_of_shape_are_those_of_the_instance(name):
    drawn_ones = [FAMILIES[name].draw(np.random.default_rng(seed)) for seed in range(30)]
    forms = {vars(one)["form"] for one in drawn_ones}
    assert len(forms) > 1
    for one in drawn_ones:
        words = one.words()
        said = {
            form
            for form in forms
            for p in (*words.seen, *words.unseen)
            if re.search(rf"\b{form}\b", p)
        }
        assert said <= {vars(one)["form"]}, one


@pytest.fixture(scope="module")
def settled() -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """Poses (7,) after one second on a table, as displacement and quaternion, of three instances of
    every family."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 240)
    scene.add_ground(0, render=False)
    placed = {}
    for i, name in enumerate(NAMES):
        for k in range(3):
            spot = np.array([1.5 * k, 1.5 * i, 0.002])
            placed[name, k] = (add(scene, built(name)[k][1], spot), spot)
    for _ in range(240):
        scene.step()
    return {key: (entity.pose.p - spot, entity.pose.q) for key, (entity, spot) in placed.items()}


def add(scene: sapien.Scene, shape: Shape, at: np.ndarray) -> sapien.Entity:
    material = sapien.physx.PhysxMaterial(shape.friction, shape.friction, 0.0)
    body = sapien.physx.PhysxRigidDynamicComponent()
    total = sum(c.weight * c.volume() for c in shape.collision)
    for c in shape.collision:
        local = sapien.Pose(c.pose[:3], c.pose[3:])
        if c.kind == "box":
            piece = sapien.physx.PhysxCollisionShapeBox(c.size, material)
        elif c.kind == "sphere":
            piece = sapien.physx.PhysxCollisionShapeSphere(c.size[0], material)
        elif c.kind == "convex":
            piece = sapien.physx.PhysxCollisionShapeConvexMesh(
                np.asarray(c.vertices, np.float32), (1, 1, 1), material
            )
        else:
            form = (
                sapien.physx.PhysxCollisionShapeCylinder
                if c.kind == "cylinder"
                else sapien.physx.PhysxCollisionShapeCapsule
            )
            piece = form(c.size[0], c.size[1], material)
            local = local * sapien.Pose(q=[0.5**0.5, 0, 0.5**0.5, 0])
        piece.set_local_pose(local)
        piece.set_density(shape.mass * c.weight / total)
        body.attach(piece)
    entity = sapien.Entity()
    entity.add_component(body)
    entity.set_pose(sapien.Pose(at))
    scene.add_entity(entity)
    return entity


@pytest.mark.parametrize("name", NAMES)
def test_objects_rest_where_they_are_put(name, settled):
    for k in range(3):
        moved, turned = settled[name, k]
        assert np.linalg.norm(moved[:2]) < 0.005
        assert abs(moved[2] + 0.002) < 0.003
        tilt = np.degrees(np.arccos(np.clip(quat_rotate(turned, (0, 0, 1))[2], -1, 1)))
        assert tilt < 2


@pytest.mark.parametrize("name", sorted(HOLLOW & set(NAMES)))
def test_hollow_things_take_a_ball(name):
    one, shape = built(name)[0]
    target = one.frames()["inside"]
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 240)
    scene.add_ground(0, render=False)
    add(scene, shape, np.zeros(3))
    builder = scene.create_actor_builder()
    builder.add_sphere_collision(radius=0.008, material=sapien.physx.PhysxMaterial(0.5, 0.5, 0.0))
    ball = builder.build()
    start = np.array([target[0] + 0.004, target[1] + 0.003, shape.aabb()[1, 2] + 0.02])
    ball.set_pose(sapien.Pose(start))
    for _ in range(240):
        scene.step()
    assert ball.pose.p[2] == pytest.approx(target[2] + 0.008, abs=0.006)


def test_an_unknown_name_twice_is_refused():
    from pipeline.world.objects.contract import register

    with pytest.raises(ValueError, match="twice"):
        register("bell")(type("Other", (), {}))
