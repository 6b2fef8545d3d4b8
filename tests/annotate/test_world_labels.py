"""The stage `world` against ray casting, brute-force projection and finite differences."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from pipeline.annotate.options import WorldOptions
from pipeline.annotate.world_stage import WorldStage, sample_points
from pipeline.data.cameras import Camera, CameraType, extrinsics_cv, intrinsics, look, world_poses
from pipeline.data.episode.state_log import CONTACT_DTYPE, Event
from pipeline.data.episode.world import BodyFacts, WorldTruth, twists_of
from pipeline.poses import compose, inverse, matrix, pose, quat_about, quat_rotate, transform
from pipeline.world.drawing.room import box
from pipeline.world.drawing.silhouettes import occluders_of, track_bodies
from pipeline.world.drawing.truth import surfaces_of
from pipeline.world.looks.materials import plastic
from tests.synthetic import make_log

KIND = CameraType(64, 48, 50.0)
FRAMES = 3
PARTS = {
    "block": [(box((0, 0, 0), (0.06, 0.04, 0.05)), plastic("teal"))],
    "wall": [(box((0, 0, 0.02), (0.05, 0.01, 0.1)), plastic("red"))],
    "hand": [(box((0, 0.02, 0), (0.01, 0.01, 0.01)), plastic("red"))],
}
FLOOR = [(box((0, 0, 0.7), (1.5, 1.5, 0.02)), plastic("white"))]
HZ = 240


@pytest.fixture(scope="module")
def seen():
    """Two bodies that move and turn in front of a camera on a moving hand, and its labels."""
    t = np.arange(FRAMES)
    poses = {
        "block": np.stack(
            [pose((0.02 * i, 0.05, 0.85), quat_about((1, 2, 3), 0.3 + 0.2 * i)) for i in t]
        ),
        "wall": np.stack([pose((0.06, -0.05 + 0.01 * i, 0.80)) for i in t]),
        "hand": np.stack(
            [compose(look((0.03 * i, -0.45, 1.1), (0, 0.6, -0.4)), pose((-0.1, 0, 0))) for i in t]
        ),
    }
    camera = Camera("wrist", KIND, "hand", pose((0.1, 0, 0)))
    surfaces = surfaces_of(occluders_of(PARTS, FLOOR), poses, camera)
    at = world_poses(camera, poses, FRAMES)
    objects = ("block", "wall")
    track = track_bodies(occluders_of(PARTS, FLOOR), poses, objects, KIND, at)
    facts = {n: BodyFacts(m.vertices, m.triangles, 0.2, 0.5) for n, ((m, _),) in PARTS.items()}
    truth = WorldTruth(facts, surfaces, objects, track.box, track.visible)
    log = make_log("aloha-agilex", FRAMES, 15, 0)
    log.bodies, log.poses = tuple(PARTS), np.stack([poses[n] for n in PARTS], 1)
    log.target_velocity, log.target_angular_velocity = np.ones((FRAMES, 3)), None
    log.contacts = np.array([(1, 0, 1, 0.01, (0, 0, 0.8), 2)], CONTACT_DTYPE)
    log.events = [Event("meeting", float(log.times[1]), "hand")]
    drawing = SimpleNamespace(latency=0.0)
    meta = SimpleNamespace(
        target="block", physics_hz=HZ, drawing=drawing, meeting_time=9.0, events=()
    )
    episode = SimpleNamespace(
        log=log, meta=meta, interception={"meeting_position": np.array([0.02, 0.05, 0.85])}
    )
    result = WorldStage(WorldOptions(points=100)).compute((episode, truth))
    return SimpleNamespace(poses=poses, at=at, result=result, log=log, facts=facts)


def scene_of(seen, t: int) -> trimesh.Trimesh:
    """All triangles of a frame in the world; `face_attributes` name the body."""
    parts, names = [], []
    for i, ((mesh, _),) in enumerate([*PARTS.values(), FLOOR]):
        at = seen.poses[list(PARTS)[i]][t] if i < len(PARTS) else pose()
        parts.append(trimesh.Trimesh(transform(at, mesh.vertices), mesh.triangles, process=False))
        names += [(i + 1) % (len(PARTS) + 1)] * len(mesh.triangles)
    merged = trimesh.util.concatenate(parts)
    return trimesh.Trimesh(
        merged.vertices, merged.faces, process=False, face_attributes={"body": np.array(names)}
    )


def first_hits(scene: trimesh.Trimesh, eye, targets):
    """The first triangle (-1: none) on the way from the eye through each target, and where: every
    ray against every triangle (Moller and Trumbore 1997)."""
    ways = (targets - eye)[:, None]
    a, b, c = scene.triangles.transpose(1, 0, 2)
    across = np.cross(ways, c - a)
    area = np.sum((b - a) * across, -1)
    area = np.where(np.abs(area) < 1e-15, np.inf, area)
    u = np.sum((eye - a) * across, -1) / area
    over = np.cross(eye - a, b - a)
    v, far = np.sum(ways * over, -1) / area, np.sum((c - a) * over, -1) / area
    hit = (u > -1e-9) & (v > -1e-9) & (u + v < 1 + 1e-9) & (far > 1e-6)
    far = np.where(hit, far, np.inf)
    faces, first = far.argmin(1), far.min(1)
    at = eye + (targets - eye) * np.where(np.isfinite(first), first, 1e9)[:, None]
    return np.where(np.isfinite(first), faces, -1), at


def test_depth_bodies_and_normals_are_those_of_rays_through_the_pixels(seen):
    k, t = intrinsics(KIND), 2
    rows, columns = np.mgrid[1:48:3, 1:64:3].reshape(2, -1)
    rays = np.stack(
        [(columns + 0.5 - k[0, 2]) / k[0, 0], (rows + 0.5 - k[1, 2]) / k[1, 1], 1 + 0 * rows], 1
    )
    to_world = np.linalg.inv(np.vstack([extrinsics_cv(seen.at[t]), [0, 0, 0, 1]]))
    scene = scene_of(seen, t)
    faces, at = first_hits(scene, to_world[:3, 3], rays @ to_world[:3, :3].T + to_world[:3, 3])
    hit = faces >= 0
    arrays = seen.result.arrays
    assert {0, 1, 2} <= set(scene.face_attributes["body"][faces[hit]].tolist())
    found = arrays["segmentation"][t][rows, columns][hit]
    same = found == scene.face_attributes["body"][faces[hit]]
    assert same.mean() > 0.99
    z = (at[hit] - to_world[:3, 3]) @ to_world[:3, 2]
    depth = arrays["depth"][t][rows, columns][hit]
    assert np.median(np.abs(depth - z)) < 1e-6 and np.abs(depth - z)[same].max() < 0.01
    normals = scene.face_normals[faces[hit]] @ to_world[:3, :3]
    cosine = np.sum(normals * arrays["normals"][t][rows, columns][hit].astype(float), 1)
    assert (cosine[same] > 0.999).mean() > 0.98


def test_tracked_points_are_vertices_of_the_surface_and_visible_where_a_ray_meets_them(seen):
    arrays, t = seen.result.arrays, 1
    world = np.concatenate(
        [
            transform(seen.poses[n][t], sample_points(seen.facts[n], 100, i)[0])
            for i, n in enumerate(PARTS)
        ]
    )
    e = extrinsics_cv(seen.at[t])
    np.testing.assert_allclose(arrays["tracks_XYZ"][t], world @ e[:, :3].T + e[:, 3], atol=1e-6)
    projected = arrays["tracks_XYZ"][t].astype(float) @ intrinsics(KIND).T
    front = arrays["tracks_XYZ"][t][:, 2] > 0.01
    np.testing.assert_allclose(
        arrays["tracks_XY"][t][front], (projected[:, :2] / projected[:, 2:])[front], atol=1e-3
    )
    eye = -e[:, :3].T @ e[:, 3]
    _, at = first_hits(scene_of(seen, t), eye, world)
    uv = arrays["tracks_XY"][t]
    inside = front & (uv >= 0).all(1) & (uv[:, 0] < KIND.width) & (uv[:, 1] < KIND.height)
    met = inside & (np.linalg.norm(at - world, axis=1) < 1e-4)
    assert 20 < met.sum() < 250
    assert (met == arrays["visibility"][t]).mean() > 0.97


def test_flow_is_the_way_of_projected_points_between_two_frames(seen):
    """Points of the surfaces, projected in both frames, against the flow at their pixels."""
    arrays, t = seen.result.arrays, 1
    shown = arrays["visibility"][t]
    uv = arrays["tracks_XY"]
    column, row = np.floor(uv[t][shown]).astype(int).T
    for name, other in (("flow_forward", 2), ("flow_backward", 0)):
        flow = arrays[name][t][row, column].astype(float)
        error = np.linalg.norm(flow - (uv[other] - uv[t])[shown], axis=1)
        assert np.median(error) < 0.15 and np.median(np.linalg.norm(flow, axis=1)) > 1
    # a pixel's own point, moved by brute force
    k, (y, x) = intrinsics(KIND), (row[0], column[0])
    body = arrays["segmentation"][t][y, x] - 1
    point = arrays["depth"][t][y, x] * np.array(
        [(x + 0.5 - k[0, 2]) / k[0, 0], (y + 0.5 - k[1, 2]) / k[1, 1], 1.0]
    )
    e = [np.vstack([extrinsics_cv(p), [0, 0, 0, 1]]) for p in seen.at]
    world = np.linalg.inv(e[t]) @ [*point, 1]
    poses = seen.poses[list(PARTS)[body]]
    moved = matrix(poses[2]) @ np.linalg.inv(matrix(poses[t])) @ world
    in_next = k @ (e[2] @ moved)[:3]
    np.testing.assert_allclose(
        arrays["flow_forward"][t][y, x], in_next[:2] / in_next[2] - [x + 0.5, y + 0.5], atol=0.02
    )
    np.testing.assert_allclose(
        arrays["scene_flow"][t][y, x], (moved - world)[:3], rtol=2e-3, atol=1e-5
    )
    assert not arrays["scene_flow"][-1].any() and not arrays["flow_backward"][0].any()


def test_boxes_hold_all_vertices_and_touch_the_outermost_ones(seen):
    arrays, k = seen.result.arrays, intrinsics(KIND)
    for n, name in enumerate(("block", "wall")):
        vertices = transform(seen.poses[name][0], seen.facts[name].vertices)
        e = extrinsics_cv(seen.at[0])
        local = vertices @ e[:, :3].T + e[:, 3]
        uv = (local @ k.T)[:, :2] / local[:, 2:]
        np.testing.assert_allclose(arrays["box_2d"][0, n], [*uv.min(0), *uv.max(0)], atol=1e-3)
        # these bodies are boxes: their corners are the vertices
        corners = arrays["box_3d"][0, n]
        apart = np.linalg.norm(corners[:, None] - local[None], axis=-1)
        assert apart.min(1).max() < 1e-5 and apart.min(0).max() < 1e-5
    share = arrays["visible_share"]
    assert (share[:, 1] > 0.95).all() and (share[:, 0] < 0.9).all()


def test_twists_are_what_moves_points_and_the_recorded_ones_of_the_target(seen):
    rng = np.random.default_rng(0)
    log, local = seen.log, rng.normal(size=3)
    twist = twists_of(log, SimpleNamespace(target="wall", events=()))
    at = transform(log.poses[:, 0], local)
    moved = (at[2] - at[0]) / (log.times[2] - log.times[0])
    arm = quat_rotate(log.poses[1, 0, 3:], local)
    np.testing.assert_allclose(twist[1, 0, :3] + np.cross(twist[1, 0, 3:], arm), moved, rtol=0.08)
    np.testing.assert_array_equal(twist[:, 1, :3], log.target_velocity)
    turned = compose(log.poses[2, 0], inverse(log.poses[0, 0]))
    seconds = log.times[2] - log.times[0]
    assert np.linalg.norm(twist[1, 0, 3:]) == pytest.approx(
        2 * np.arccos(abs(turned[3])) / seconds, rel=1e-6
    )


def test_the_meeting_and_the_contacts(seen):
    a = seen.result.arrays
    np.testing.assert_allclose(a["time_to_contact"], seen.log.times[1] - seen.log.times, atol=1e-6)
    np.testing.assert_allclose(a["contact_force"], [0.01 * HZ], rtol=1e-6)
    e = extrinsics_cv(seen.at[1])
    np.testing.assert_allclose(
        a["meeting_XYZ"][1], e[:, :3] @ [0.02, 0.05, 0.85] + e[:, 3], atol=1e-6
    )
