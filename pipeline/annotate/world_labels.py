"""Labels of one camera from what the simulator knows: point tracks, flow, scene flow, boxes. Camera
frames are OpenCV's (x right, y down, z forward), metres."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.sim_flow import body_motions, exact_flow, pixel_rays
from pipeline.data.cameras import CameraType, Surfaces, extrinsics_cv, intrinsics
from pipeline.data.episode.world import BodyFacts
from pipeline.poses import Floats, inverse, matrix, quat_rotate, transform

PIXEL = 0.7
"""Half the diagonal of a pixel: a point this far (px) behind the surface of its pixel is seen."""


def sample_points(body: BodyFacts, count: int, seed: int) -> tuple[Floats, Floats]:
    """Points (N,3) spread evenly by area over a body's surface, in its frame, and the normals (N,3)
    there."""
    rng = np.random.default_rng(seed)
    corners = body.vertices[body.triangles].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = corners[chosen].transpose(1, 0, 2)
    return a * (1 - u) + b * u * (1 - v) + c * u * v, normals[chosen] / area[chosen, None]


def project_points(kind: CameraType, points: Floats) -> Floats:
    """Pixels (...,2) of points (...,3) in the camera frame; zeros for those that are not in front
    of it."""
    k = intrinsics(kind)
    front = points[..., 2:] > 1e-6
    uv = points[..., :2] / np.where(front, points[..., 2:], 1.0) * k[0, 0] + k[:2, 2]
    return np.where(front, uv, 0.0)


def point_tracks(
    surfaces: Surfaces, poses: Floats, bodies: Sequence[BodyFacts], count: int
) -> dict[str, NDArray[Any]]:
    """Tracks of `count` points of each body, of world `poses` (T,B,7), in the layout of TAPVid-3D:
    tracks_XYZ (T,N,3) in the camera frame, tracks_XY (T,N,2) px, visibility (T,N), extrinsics
    (T,4,4) from world to camera, and the intrinsics (T,4) fx, fy, cx, cy."""
    kind, frames = surfaces.camera.type, len(poses)
    extrinsics = np.broadcast_to(np.eye(4), (frames, 4, 4)).copy()
    extrinsics[:, :3] = extrinsics_cv(surfaces.poses)
    at, facing = list[Floats](), list[Floats]()
    for i, body in enumerate(bodies):
        points, normals = sample_points(body, count, i)
        pose = poses[:, i, None]
        at.append(transform(pose, points))
        facing.append(quat_rotate(pose[..., 3:], normals))
    world, normals = np.concatenate(at, 1), np.concatenate(facing, 1)
    xyz = np.einsum("tij,tnj->tni", extrinsics[:, :3, :3], world) + extrinsics[:, None, :3, 3]
    turned = np.einsum("tij,tnj->tni", extrinsics[:, :3, :3], normals)
    xy = project_points(kind, xyz)
    k = intrinsics(kind)
    return {
        "tracks_XYZ": xyz.astype(np.float32),
        "tracks_XY": xy.astype(np.float32),
        "visibility": (np.sum(turned * xyz, -1) < 0) & _unoccluded(surfaces, xyz, xy),
        "extrinsics": extrinsics.astype(np.float32),
        "intrinsics": np.tile(k[[0, 1, 0, 1], [0, 1, 2, 2]].astype(np.float32), (frames, 1)),
    }


def _unoccluded(surfaces: Surfaces, xyz: Floats, xy: Floats) -> NDArray[np.bool_]:
    """Which points (T,N) are in the image and not behind the plane that their pixel shows."""
    kind = surfaces.camera.type
    column, row = np.floor(xy[..., 0]).astype(int), np.floor(xy[..., 1]).astype(int)
    inside = (xyz[..., 2] > 1e-6) & (column >= 0) & (row >= 0)
    inside &= (column < kind.width) & (row < kind.height)
    at = (np.arange(len(xyz))[:, None], np.where(inside, row, 0), np.where(inside, column, 0))
    depth = surfaces.depth[at].astype(float)
    rays = pixel_rays((kind.height, kind.width), intrinsics(kind))[at[1:]]
    above = np.sum((xyz - rays * depth[..., None]) * surfaces.normals[at].astype(float), -1)
    slack = PIXEL * xyz[..., 2] / intrinsics(kind)[0, 0]
    return inside & ((depth == 0) | (above > -slack))


def dense_motion(surfaces: Surfaces, poses: Floats) -> dict[str, NDArray[Any]]:
    """How what each pixel shows moves; zeros at the end that has no other frame.

    `flow_forward` (T,H,W,2) px to the next frame, `flow_backward` to the one before, `scene_flow`
    (T,H,W,3) m in the world until the next frame. `poses` (T,B,7) are those of the bodies in the
    order of the segmentation.
    """
    k, frames = intrinsics(surfaces.camera.type), len(poses)
    shape = surfaces.depth.shape
    found = {
        "flow_forward": np.zeros((*shape, 2), np.float16),
        "flow_backward": np.zeros((*shape, 2), np.float16),
        "scene_flow": np.zeros((*shape, 3), np.float16),
    }
    rays = pixel_rays(shape[1:], k)
    for t in range(frames):
        depth, labels = surfaces.depth[t].astype(float), surfaces.segmentation[t]
        for name, other in (("flow_forward", t + 1), ("flow_backward", t - 1)):
            if 0 <= other < frames:
                motions = body_motions(
                    poses[t], poses[other], surfaces.poses[t], surfaces.poses[other]
                )
                found[name][t] = exact_flow(depth, labels, k, motions)
        if t + 1 < frames:
            to_world = np.linalg.inv(np.vstack([extrinsics_cv(surfaces.poses[t]), [0, 0, 0, 1]]))
            moves = matrix(poses[t + 1]) @ matrix(inverse(poses[t])) - np.eye(4)
            for label in np.unique(labels[labels > 0]):
                here = labels == label
                points = (rays[here] * depth[here][:, None]) @ to_world[:3, :3].T + to_world[:3, 3]
                move = moves[label - 1]
                found["scene_flow"][t][here] = points @ move[:3, :3].T + move[:3, 3]
    return found


def boxes_3d(surfaces: Surfaces, poses: Floats, bodies: Sequence[BodyFacts]) -> Floats:
    """Corners (T,N,8,3) in the camera frame of the boxes around bodies along the axes of their own
    frames; `poses` (T,N,7) in the world."""
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = np.stack(
        [np.where(signs, b.vertices.max(0), b.vertices.min(0)).astype(float) for b in bodies]
    )
    world = transform(poses[:, :, None], corners)
    e = extrinsics_cv(surfaces.poses)
    return np.einsum("tij,tncj->tnci", e[:, :, :3], world) + e[:, None, None, :, 3]


def in_camera(surfaces: Surfaces, point: Floats) -> tuple[Floats, Floats]:
    """A world point (3,) in the camera frame (T,3), and its pixels (T,2)."""
    e = extrinsics_cv(surfaces.poses)
    xyz = e[:, :, :3] @ point + e[:, :, 3]
    return xyz, project_points(surfaces.camera.type, xyz)
