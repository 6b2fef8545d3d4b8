"""What every embodiment promises: names, limits, cameras, home, furniture, size of its image."""

import itertools

import numpy as np
import pytest

from pipeline.data.cameras import CAMERA_TYPES, project, visible
from pipeline.data.names import SIDES
from pipeline.poses import compose, matrix, transform
from pipeline.world.cameras import cameras_of
from pipeline.world.drawing.silhouettes import occluders_of, track_bodies
from pipeline.world.robots import ALIASES, MODELS, UnknownEmbodiment, canonical_name, get_embodiment
from pipeline.world.robots.contract import (
    Embodiment,
    arm_poses,
    jaw_positions,
    jaw_value,
    root_link,
)
from tests.world.robots.both_arms import tcp_pose
from tests.world.robots.limits import arm_limits

NAMES = (*MODELS, "piper+franka-panda")


def test_aliases_and_case():
    assert get_embodiment("ARX-X5") is get_embodiment("arx")
    assert get_embodiment("Aloha_Agilex").name == "aloha-agilex"
    for alias, name in ALIASES.items():
        assert get_embodiment(alias).name == name
        assert alias in get_embodiment(name).aliases


@pytest.mark.parametrize("name", ["pipper", "", "piper+", "piper+ur5+arx", "piper+nobody"])
def test_unknown_names_say_what_exists(name):
    with pytest.raises(
        UnknownEmbodiment, match=rf"choose {', '.join(MODELS)} or a pair .*left\+right"
    ):
        get_embodiment(name)


def test_mixed_pairs_take_each_side_from_its_model():
    mixed, piper, panda = (get_embodiment(n) for n in ("agilex-piper+panda", "piper", "franka"))
    assert mixed.name == "piper+franka-panda" == canonical_name("Piper + Franka_Panda")
    assert mixed.arms["left"].model == "piper" and mixed.arms["right"].model == "franka-panda"
    np.testing.assert_array_equal(mixed.arms["left"].base, piper.arms["left"].base)
    np.testing.assert_array_equal(mixed.arms["right"].base, panda.arms["right"].base)
    assert len(mixed.vector_names) == 15
    assert get_embodiment("ur5+ur5-wsg") is get_embodiment("ur5")


@pytest.mark.parametrize("left, right", itertools.product(MODELS, MODELS))
def test_every_pair_can_be_built(left, right):
    e = get_embodiment(f"{left}+{right}")
    assert [e.arms[side].model for side in SIDES] == [left, right]
    assert e.furniture and e.furniture_collision


@pytest.mark.parametrize("name", MODELS)
def test_vector_names(name):
    names = get_embodiment(name).vector_names
    dof = 7 if name == "franka-panda" else 6
    assert len(names) == len(set(names)) == 2 * dof + 2
    assert names[dof] == "left_gripper" and names[-1] == "right_gripper"
    assert names[0].startswith("left_") and names[dof + 1].startswith("right_")


@pytest.mark.parametrize("name", NAMES)
def test_home_and_jaws_are_inside_the_limits(name):
    for arm in get_embodiment(name).arms.values():
        lower, upper = arm_limits(arm).T
        assert np.all(lower < arm.home) and np.all(arm.home < upper)
        by_name = {j.name: j for j in arm.joints}
        for value in (0.0, 0.3, 1.0):
            q = jaw_positions(arm.gripper, value)
            for position, joint in zip(q, arm.gripper.joints, strict=True):
                assert by_name[joint].lower - 1e-9 <= position <= by_name[joint].upper + 1e-9
            assert jaw_value(arm.gripper, q) == pytest.approx(value)
        moving = [j for j in arm.joints if j.kind != "fixed"]
        assert all(j.velocity > 0 and j.effort > 0 for j in moving)
        assert {j.name for j in moving} == {*arm.arm_joints, *arm.gripper.joints}


@pytest.mark.parametrize("name", NAMES)
def test_links_form_one_tree_with_plausible_inertias(name):
    for arm in get_embodiment(name).arms.values():
        names = [link.name for link in arm.links]
        assert len(set(names)) == len(names)
        children = [j.child for j in arm.joints]
        assert sorted([*children, root_link(arm)]) == sorted(names)
        assert {arm.hand, arm.camera.link, *arm.gripper.fingers} <= set(names)
        assert {n for pair in arm.allowed_overlap for n in pair} <= set(names)
        for link in arm.links:
            # a body no smaller than 5 mm and no larger than 1 m
            assert 2.5e-5 * link.mass <= min(link.inertia) and max(link.inertia) <= link.mass
            x, y, z = sorted(link.inertia)
            assert link.mass > 0 and x + y > 0.75 * z


def link_points(e: Embodiment, side: str, q: np.ndarray, value: float) -> dict[str, np.ndarray]:
    poses = arm_poses(e.arms[side], q, value)
    return {
        link.name: np.concatenate(
            [transform(poses[link.name], mesh.vertices) for mesh, _ in link.visual]
        )
        for link in e.arms[side].links
        if link.visual
    }


@pytest.mark.parametrize("name", NAMES)
def test_wrist_camera_sees_both_finger_ends_and_what_lies_between(name):
    e = get_embodiment(name)
    kind = CAMERA_TYPES["D435"]
    for side in SIDES:
        arm = e.arms[side]
        q = np.array(arm.home)
        for value in (0.0, 0.5, 1.0):
            camera = compose(arm_poses(arm, q, value)[arm.camera.link], arm.camera.pose)
            tcp = tcp_pose(arm, q)
            assert visible(kind, camera, tcp[:3], margin=20)
            for points in (link_points(e, side, q, value)[f] for f in arm.gripper.fingers):
                along = (points - tcp[:3]) @ matrix(tcp)[:3, 0]
                assert visible(kind, camera, points[along > 0.003]).mean() > 0.95
                assert visible(kind, camera, points[along > 0.008]).all()
            # the camera looks along the approach, with the tool's z up
            uv, _ = project(
                kind, camera, transform(tcp, np.array([[0, 0, 0.0], [0, 0, 0.02], [0, 0.02, 0]]))
            )
            assert uv[1, 1] < uv[0, 1] - 10 and uv[2, 0] < uv[0, 0] - 10


@pytest.mark.parametrize("name", NAMES)
def test_of_its_own_arm_a_wrist_camera_sees_the_fingers_only(name):
    e = get_embodiment(name)
    for camera in cameras_of(e)[1:]:
        side = camera.name.split("_")[0]
        arm = e.arms[side]
        poses = {name: at[None] for name, at in arm_poses(arm, arm.home).items()}
        solids = occluders_of({link.name: link.visual for link in arm.links}, ())
        others = [
            link.name for link in arm.links if link.visual and link.name not in arm.gripper.fingers
        ]
        world = compose(poses[arm.camera.link], camera.pose)
        assert not track_bodies(solids, poses, others, camera.type, world).visible.any()


@pytest.mark.parametrize("name", NAMES)
def test_head_camera_is_not_blocked_at_home(name):
    """No part of the robot or its furniture covers the table where objects are: |x| <= 0.4, y in
    -0.2..0.25."""
    e = get_embodiment(name)
    head = cameras_of(e)[0]
    table = np.array([[x, y, 0.74] for x in (-0.25, 0.0, 0.25) for y in (-0.15, 0.2)])
    uv, depth = project(head.type, head.pose, table)
    clouds = [
        points
        for side in SIDES
        for points in link_points(e, side, np.array(e.arms[side].home), 1.0).values()
    ]
    clouds += [mesh.vertices.astype(float) for mesh, _ in e.furniture]
    points = np.concatenate(clouds)
    seen = visible(head.type, head.pose, points)
    pixels, d = project(head.type, head.pose, points[seen])
    centre = (pixels[:, 0] > 60) & (pixels[:, 0] < head.type.width - 60)
    assert not centre.any(), "the middle of the image is free of the robot at home"
    assert depth.min() > 0.5 and uv.shape == (6, 2) and d.size == pixels.shape[0]


@pytest.mark.parametrize("name", NAMES)
def test_budget_and_meshes(name):
    e = get_embodiment(name)
    visuals = [link.visual for side in SIDES for link in e.arms[side].links] + [e.furniture]
    assert 2000 < sum(len(mesh.triangles) for visual in visuals for mesh, _ in visual) <= 9000
    for mesh, material in itertools.chain.from_iterable(visuals):
        assert mesh.triangles.max() < len(mesh.vertices)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(float) for i in range(3))
        area = np.cross(b - a, c - a)
        # counter-clockwise triangles agree with the normals, and each joined set of closed parts
        # has positive volume
        assert (
            np.einsum("ij,ij->i", area, mesh.normals[mesh.triangles].sum(1)) > -1e-12
        ).mean() > 0.999
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0
        assert (
            0 <= material.roughness <= 1
            and 0 <= material.metallic <= 1
            and 0 <= min(material.color) <= max(material.color) <= 1
        )


@pytest.mark.parametrize("name", NAMES)
def test_furniture_keeps_clear_of_the_table(name):
    e = get_embodiment(name)
    for piece in e.furniture_collision:
        low, high = piece.support_points().min(0), piece.support_points().max(0)
        over_table = high[1] > -0.35 and low[1] < 0.35
        # over the table only above its top, under it only below its slab
        assert not over_table or low[2] >= 0.74 or high[2] <= 0.69
    for side in SIDES:
        base = e.arms[side].base[:3]
        assert -0.75 <= base[1] <= -0.3 and 0.5 <= base[2] <= 1.1


@pytest.mark.parametrize("name", NAMES)
def test_visuals_fit_their_collision_pieces(name):
    """The drawn body stays within 3 cm of its collision bounds and fills at least half of their
    extent."""
    for arm in get_embodiment(name).arms.values():
        for link in arm.links:
            if not link.collision:
                continue
            drawn = np.concatenate([mesh.vertices for mesh, _ in link.visual])
            solid = np.concatenate([c.support_points() for c in link.collision])
            assert np.all(drawn.min(0) > solid.min(0) - 0.03), (arm.model, link.name)
            assert np.all(drawn.max(0) < solid.max(0) + 0.03), (arm.model, link.name)
            assert np.all(np.ptp(drawn, axis=0) > 0.5 * np.ptp(solid, axis=0)), (
                arm.model,
                link.name,
            )
