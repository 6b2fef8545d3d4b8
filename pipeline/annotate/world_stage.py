"""The stage `world`: simulator truth of bodies and of one camera's view (docs/labels.md). Camera
frames are OpenCV's, m.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, Surfaces, extrinsics_cv, intrinsics
from pipeline.data.episode.file import Episode, EpisodeFile
from pipeline.data.episode.world import BodyFacts, WorldTruth, contact_forces, twists_of
from pipeline.data.keys import arrays_digest
from pipeline.data.names import HEAD
from pipeline.poses import Bools, Floats, inverse, matrix, quat_rotate, transform

from .flow_stage import body_motions, exact_flow, pixel_rays
from .options import WorldOptions
from .stage import AnnotateError, Reading, StageResult, Truth, check_camera

PIXEL = 0.7
"""Half the diagonal of a pixel: a point this far (px) behind the surface of its pixel is seen."""

COMPRESSED = ("depth", "segmentation", "normals", "flow_forward", "flow_backward", "scene_flow")


@dataclass(frozen=True)
class WorldStage:
    options: WorldOptions
    camera: str = HEAD
    truth: Truth | None = None

    name = "world"
    version = 1
    uses_models = False

    def parameters(self) -> dict[str, Any]:
        return {"camera": self.camera, **vars(self.options)}

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        check_camera(episode, self.camera)
        if self.truth is None:
            raise AnnotateError("the stage world needs the meshes of the dataset's assets")
        whole, path, truth = episode.read(), episode.path, self.truth
        log, drawing = whole.log, whole.meta.drawing
        arrays = {"poses": log.poses, "times": log.times, "velocity": log.target_velocity}
        arrays |= {name: log.contacts[name] for name in ("frame", "a", "b", "impulse", "point")}
        inputs = {
            "scene": {"bodies": list(log.bodies), "state": arrays_digest(arrays)},
            "events": [[e.name, e.time] for e in log.events],
            "camera": drawing.cameras[self.camera].model_dump(mode="json"),
            "latency": drawing.latency,
            "objects": {n: o.model_dump(mode="json") for n, o in whole.meta.objects.items()},
            "assets": drawing.assets,
        }
        return Reading(inputs, lambda: (whole, truth(path, self.camera)))

    def start(self) -> Callable[[Any], StageResult]:
        return self.compute

    def compute(self, data: tuple[Episode, WorldTruth]) -> StageResult:
        (episode, truth), options = data, self.options
        log, meta, surfaces, bodies = episode.log, episode.meta, truth.surfaces, truth.bodies
        late = log.late(meta.drawing.latency)
        drawn = [name for name in log.bodies if name in bodies]
        facts = [bodies[name] for name in drawn]
        seen = late.poses[:, [log.bodies.index(name) for name in drawn]]
        objects = [drawn.index(name) for name in truth.objects]
        boxes = boxes_3d(surfaces, seen[:, objects], [facts[i] for i in objects])
        contacts, met = log.contacts, log.time_of("meeting")
        place = meta.meeting_time if met is None else met
        arrays: dict[str, Any] = {
            "pose": log.poses.astype(np.float32),
            "twist": twists_of(log, meta).astype(np.float32),
            "contact_frame": contacts["frame"],
            "contact_bodies": np.stack([contacts["a"], contacts["b"]], 1),
            "contact_force": contact_forces(log, meta.physics_hz).astype(np.float32),
            "contact_point": contacts["point"],
            "time_to_contact": (place - log.times).astype(np.float32),
            "box_2d": truth.box,
            "box_3d": boxes.astype(np.float32),
            "visible_share": truth.visible,
            **point_tracks(surfaces, seen, facts, options.points),
        }
        stored = episode.interception
        point = stored.get("meeting_position", stored.get("planned_position"))
        if point is not None:
            e = extrinsics_cv(surfaces.poses)
            xyz = e[:, :, :3] @ point + e[:, :, 3]
            xy = project_points(surfaces.camera.type, xyz)
            arrays |= {"meeting_XYZ": xyz.astype(np.float32), "meeting_XY": xy.astype(np.float32)}
        if options.dense:
            arrays |= {name: getattr(surfaces, name) for name in COMPRESSED[:3]}
            arrays |= dense_motion(surfaces, late.poses)
        mass, friction = (
            {n: getattr(f, key) for n, f in bodies.items() if getattr(f, key) is not None}
            for key in ("mass", "friction")
        )
        attributes = {
            "bodies": list(log.bodies),
            "objects": list(truth.objects),
            "tracked": drawn,
            "mass": mass,
            "friction": friction,
            "size": {n: np.ptp(f.vertices, axis=0).round(6).tolist() for n, f in bodies.items()},
            "met": met is not None,
        }
        return StageResult(arrays, attributes, COMPRESSED if options.dense else ())


def sample_points(body: BodyFacts, count: int, seed: int) -> tuple[Floats, Floats]:
    """Points (N,3) spread by area over a body, in its frame, and their normals (N,3)."""
    rng = np.random.default_rng(seed)
    corners = body.vertices[body.triangles].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = corners[chosen].transpose(1, 0, 2)
    return a * (1 - u) + b * u * (1 - v) + c * u * v, normals[chosen] / area[chosen, None]


def project_points(kind: CameraType, points: Floats) -> Floats:
    """Pixels (...,2) of points (...,3) in the camera frame; zeros behind it."""
    k, front = intrinsics(kind), points[..., 2:] > 1e-6
    uv = points[..., :2] / np.where(front, points[..., 2:], 1.0) * k[0, 0] + k[:2, 2]
    return np.where(front, uv, 0.0)


def point_tracks(
    surfaces: Surfaces, poses: Floats, bodies: Sequence[BodyFacts], count: int
) -> dict[str, NDArray[Any]]:
    """Tracks of `count` points a body as in TAPVid-3D: tracks_XYZ (T,N,3) in the camera frame,
    tracks_XY (T,N,2) px, visibility (T,N), extrinsics (T,4,4) from world to camera, intrinsics
    (T,4).
    """
    kind, frames = surfaces.camera.type, len(poses)
    extrinsics = np.broadcast_to(np.eye(4), (frames, 4, 4)).copy()
    extrinsics[:, :3] = extrinsics_cv(surfaces.poses)
    at, facing = list[Floats](), list[Floats]()
    for i, body in enumerate(bodies):
        points, normals = sample_points(body, count, i)
        pose = poses[:, i, None]
        at.append(transform(pose, points))
        facing.append(quat_rotate(pose[..., 3:], normals))
    world, normals, turn = np.concatenate(at, 1), np.concatenate(facing, 1), extrinsics[:, :3, :3]
    xyz = np.einsum("tij,tnj->tni", turn, world) + extrinsics[:, None, :3, 3]
    turned = np.einsum("tij,tnj->tni", turn, normals)
    xy, k = project_points(kind, xyz), intrinsics(kind)
    return {
        "tracks_XYZ": xyz.astype(np.float32),
        "tracks_XY": xy.astype(np.float32),
        "visibility": (np.sum(turned * xyz, -1) < 0) & _unoccluded(surfaces, xyz, xy),
        "extrinsics": extrinsics.astype(np.float32),
        "intrinsics": np.tile(k[[0, 1, 0, 1], [0, 1, 2, 2]].astype(np.float32), (frames, 1)),
    }


def _unoccluded(surfaces: Surfaces, xyz: Floats, xy: Floats) -> Bools:
    kind, k = surfaces.camera.type, intrinsics(surfaces.camera.type)
    column, row = np.floor(xy[..., 0]).astype(int), np.floor(xy[..., 1]).astype(int)
    inside = (xyz[..., 2] > 1e-6) & (column >= 0) & (row >= 0)
    inside &= (column < kind.width) & (row < kind.height)
    at = (np.arange(len(xyz))[:, None], np.where(inside, row, 0), np.where(inside, column, 0))
    depth = surfaces.depth[at].astype(float)
    rays = pixel_rays((kind.height, kind.width), k)[at[1:]]
    above = np.sum((xyz - rays * depth[..., None]) * surfaces.normals[at].astype(float), -1)
    return inside & ((depth == 0) | (above > -PIXEL * xyz[..., 2] / k[0, 0]))


def dense_motion(surfaces: Surfaces, poses: Floats) -> dict[str, NDArray[Any]]:
    """The motion of what each pixel shows; zeros at the end without another frame.

    `flow_forward`, `flow_backward` (T,H,W,2) px; `scene_flow` (T,H,W,3) m in the world until the
    next frame. `poses` (T,B,7) are in the segmentation's order.
    """
    k, frames, shape = intrinsics(surfaces.camera.type), len(poses), surfaces.depth.shape
    widths = {"flow_forward": 2, "flow_backward": 2, "scene_flow": 3}
    maps = {name: np.zeros((*shape, width), np.float16) for name, width in widths.items()}
    rays, cameras = pixel_rays(shape[1:], k), surfaces.poses
    for t in range(frames):
        depth, labels = surfaces.depth[t].astype(float), surfaces.segmentation[t]
        for name, other in (("flow_forward", t + 1), ("flow_backward", t - 1)):
            if 0 <= other < frames:
                motions = body_motions(poses[t], poses[other], cameras[t], cameras[other])
                maps[name][t] = exact_flow(depth, labels, k, motions)
        if t + 1 < frames:
            to_world = np.linalg.inv(np.vstack([extrinsics_cv(cameras[t]), [0, 0, 0, 1]]))
            moves = matrix(poses[t + 1]) @ matrix(inverse(poses[t])) - np.eye(4)
            for label in np.unique(labels[labels > 0]):
                here, move = labels == label, moves[label - 1]
                points = (rays[here] * depth[here][:, None]) @ to_world[:3, :3].T + to_world[:3, 3]
                maps["scene_flow"][t][here] = points @ move[:3, :3].T + move[:3, 3]
    return maps


def boxes_3d(surfaces: Surfaces, poses: Floats, bodies: Sequence[BodyFacts]) -> Floats:
    """Corners (T,N,8,3) in the camera frame of bodies' own boxes; world `poses` (T,N,7)."""
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = np.stack(
        [np.where(signs, b.vertices.max(0), b.vertices.min(0)).astype(float) for b in bodies]
    )
    world, e = transform(poses[:, :, None], corners), extrinsics_cv(surfaces.poses)
    return np.einsum("tij,tncj->tnci", e[:, :, :3], world) + e[:, None, None, :, 3]
