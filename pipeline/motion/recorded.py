"""The arrays of the group `interception`, from the state log and the target's motion. Poses are
interpolated between frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, extrinsics_cv, intrinsics
from pipeline.data.episode.events import by_role
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.episode.state_log import StateLog, Touch
from pipeline.data.names import SIDES
from pipeline.poses import Bools, Floats, Ints, Pose, compose, inverse

from .contract import TargetMotion

GRASP_SECONDS = 0.2
GRASP_DRIFT = 0.005  # m
GRASP_TRAVEL = 0.02  # m


@dataclass(frozen=True, eq=False)
class Interception:
    """Derived data of one episode as it was `recorded`. In `log` the target's name is that of
    what has its role."""

    meta: EpisodeMeta
    recorded: StateLog
    motion: TargetMotion

    @cached_property
    def log(self) -> StateLog:
        return by_role(self.recorded, self.meta.events, self.meta.target)

    @property
    def target(self) -> Floats:
        """World poses (T,7)."""
        return self.log.pose(self.meta.target)

    @property
    def rate(self) -> int:
        return self.meta.physics_hz

    @cached_property
    def steps(self) -> Ints:
        """(T,) physics step of every frame."""
        return np.rint(self.log.times * self.meta.physics_hz).astype(np.int64)

    @property
    def motion_start(self) -> float:
        """Time (s) at which the target begins to move, maybe negative."""
        return -self.motion.lead

    @property
    def planned_position(self) -> Floats:
        """(3,) where target and robot are to meet (m)."""
        return self.motion.pose(self.meta.meeting_time)[:3]

    @cached_property
    def contact_pairs(self) -> Ints:
        """(T,2) links of each arm that touched the target since the last frame."""
        return self._summed(lambda rows: np.ones(len(rows), np.int64), np.int64)

    @cached_property
    def contact_centroids(self) -> Floats:
        """(T,2,3) mean contact point by arm (m, world); zeros for none."""
        sums = self._summed(lambda r: r["points"][:, None] * r["point"].astype(float), float, 3)
        return sums / np.maximum(self.contact_points, 1)[..., None]

    @cached_property
    def contact_points(self) -> Ints:
        """(T,2) number of contact points of each arm with the target."""
        return self._summed(lambda rows: rows["points"], np.int64)

    def _summed(
        self, values: Callable[[NDArray[np.void]], NDArray[Any]], dtype: type, *shape: int
    ) -> NDArray[Any]:
        """Sums (T,2,...) of values of the target's contacts with each arm, by frame and arm."""
        sums = np.zeros((len(self.log), len(SIDES), *shape), dtype)
        every, bodies = self.log.contacts, self.log.bodies
        body = bodies.index(self.meta.target)
        links = [
            (index, SIDES.index(name.partition("_")[0]))
            for index, name in enumerate(bodies)
            if name.startswith(("left_", "right_")) and name not in self.meta.objects
        ]
        for side in range(len(SIDES)):
            own = [index for index, of in links if of == side]
            touched = (every["a"] == body) & np.isin(every["b"], own)
            rows = every[touched | ((every["b"] == body) & np.isin(every["a"], own))]
            np.add.at(sums[:, side], rows["frame"], values(rows))
        return sums

    @cached_property
    def first_contacts(self) -> dict[str, Touch]:
        return {touch.side: touch for touch in self.log.touches}

    @cached_property
    def held(self) -> Bools:
        """(T,2) whether each arm holds the target: touching and steady for GRASP_SECONDS, then
        travelling GRASP_TRAVEL together: a press is no grasp.
        """
        window = max(1, round(GRASP_SECONDS * self.meta.fps))
        out = np.zeros((len(self.log), len(SIDES)), bool)
        for name in self.log.sides:
            side, steady = SIDES.index(name), np.zeros(len(self.log), np.int64)
            local = compose(inverse(self.log.tcp[:, self.log.sides.index(name)]), self.target)
            for t in range(window, len(self.log)):
                drift = np.linalg.norm(local[t - window : t + 1, :3] - local[t, :3], axis=1).max()
                touched = self.contact_pairs[t - window + 1 : t + 1, side] > 0
                steady[t] = touched.all() and drift <= GRASP_DRIFT
            edges = np.flatnonzero(np.diff(np.concatenate([[0], steady, [0]])))
            for start, end in edges.reshape(-1, 2):
                way = self.target[start:end, :3] - self.target[start, :3]
                out[start:end, side] = np.linalg.norm(way, axis=1).max() >= GRASP_TRAVEL
        return out

    def grasp_pose(self) -> Floats:
        """(T,7) the tcp pose of the first contact, carried with the target; else the target's."""
        first = min(self.log.touches, key=lambda touch: (touch.step, touch.side), default=None)
        if first is None:
            return self.target.copy()
        return compose(self.target, compose(inverse(first.target), np.array(first.tcp)))


def pose_at(times: Floats, poses: Floats, time: float) -> Pose:
    """Pose (7,) at a time (s), interpolated; the nearest one outside `times`."""
    after = int(np.clip(np.searchsorted(times, time), 1, max(len(times) - 1, 1)))
    if len(times) == 1:
        return poses[0].copy()
    a, b = poses[after - 1], poses[after]
    u = float(np.clip((time - times[after - 1]) / (times[after] - times[after - 1]), 0.0, 1.0))
    quaternion = (1 - u) * a[3:] + u * (b[3:] if a[3:] @ b[3:] >= 0 else -b[3:])
    return np.concatenate([(1 - u) * a[:3] + u * b[:3], quaternion / np.linalg.norm(quaternion)])


def track(camera: CameraType, camera_poses: Floats, points: Floats) -> Floats:
    """(T,4) of a point (T,3): column, row (pixels), depth (m), 1 where it is in the image."""
    e = extrinsics_cv(camera_poses)
    seen = np.einsum("tij,tj->ti", e[..., :3], points) + e[..., 3]
    depth = seen[:, 2]
    uv = (seen @ intrinsics(camera).T)[:, :2] / np.where(np.abs(depth) < 1e-9, 1e-9, depth)[:, None]
    inside = (
        (depth > 0) & (uv >= 0).all(1) & (uv[:, 0] <= camera.width) & (uv[:, 1] <= camera.height)
    )
    return np.column_stack([uv, depth, inside])


NEAREST = 0.01  # m before a camera


def path_ahead(positions: Floats, horizon: int) -> Floats:
    """Positions (T,H,3) in m of the next `horizon` frames, the last one repeated."""
    frames = np.arange(len(positions))[:, None] + np.arange(1, horizon + 1)
    return positions[np.minimum(frames, len(positions) - 1)]


def trace_ahead(
    camera: CameraType, camera_poses: Floats, positions: Floats, horizon: int
) -> Floats:
    """Columns, rows (pixels), depths (m) (T,H,3) of the next positions, zero less than 1 cm before
    the camera."""
    e = extrinsics_cv(camera_poses)
    seen = np.einsum("tij,thj->thi", e[..., :3], path_ahead(positions, horizon)) + e[:, None, :, 3]
    depth = seen[..., 2:]
    front = depth > NEAREST
    pixels = (seen @ intrinsics(camera).T)[..., :2] / np.where(front, depth, 1.0)
    return np.where(front, np.concatenate([pixels, depth], axis=-1), 0.0)


CONDITIONS = "conditions/"
TRACKS = "tracks/"


def physics_arrays(
    derived: Interception, conditions: Mapping[str, Bools]
) -> dict[str, NDArray[Any]]:
    """Arrays of the group `interception` (docs/formats.md), and the success conditions (T,) by
    name.
    """
    log, motion, rate = derived.log, derived.motion, derived.meta.physics_hz
    planned = derived.meta.meeting_time
    values: dict[str, NDArray[Any]] = {
        "sim_step": derived.steps,
        "sim_time": derived.steps / rate,
        "sim_timestep": np.array(1 / rate),
        "lead": np.array(float(motion.lead)),
        "motion_start_time": np.array(-motion.lead + 0.0),
        "motion_start_step": np.array(round(-motion.lead * rate)),
        "planned_time": np.array(planned),
        "planned_step": np.array(planned * rate),
        "planned_position": motion.pose(planned)[:3],
        "target_speed": np.linalg.norm(log.target_velocity, axis=1),
        "contact_mask": derived.contact_pairs > 0,
        "contact_points": derived.contact_points,
        "contact_centroid": derived.contact_centroids,
        "stable_grasp": derived.held,
    }
    real = log.time_of("meeting")
    if real is not None:
        values["meeting_time"] = np.array(real)
        values["meeting_step"] = np.array(round(real * rate))
        values["meeting_position"] = pose_at(log.times, derived.target, real)[:3]
    holding = {f"{CONDITIONS}{name}": np.asarray(holds, bool) for name, holds in conditions.items()}
    return values | holding


def conditions_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Bools]:
    names = (key for key in arrays if key.startswith(CONDITIONS))
    return {name.removeprefix(CONDITIONS): arrays[name] for name in names}


SECONDS = 0.5  # s before the first touch that are looked at

LEAST = 0.25  # share of the target's silhouette from which on it counts as seen


def before_meeting(log: StateLog, shares: NDArray[Any]) -> NDArray[Any]:
    """Rows of `shares` (T,) in the last half second before the first touch, if any."""
    met = log.time_of("meeting")
    end = float(log.times[-1]) if met is None else met
    return shares[(log.times > end - SECONDS + 1e-9) & (log.times <= end + 1e-9)]


def is_hidden(last: NDArray[Any]) -> bool:
    """Whether the target is seen in none of the frames (F,)."""
    return bool((last < LEAST).all())


def is_unoccluded(last: NDArray[Any]) -> bool:
    """Whether the target is seen in half of the frames (F,)."""
    return bool(np.mean(last >= LEAST) >= 0.5)
