"""The flow stage: flow (T,h,w,2) fp16 px, rgb (T,h,w,3), scale (T,), previous (T,) frame index.

Exact flow projects each pixel's point again after its body moved. Pixels without a body belong to
the still world, those without depth lie at infinity.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.data.cameras import extrinsics_cv
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.frames import decode_frame
from pipeline.data.names import HEAD
from pipeline.poses import Floats, Floats32, Pixels, inverse, matrix

from .flow import bit_stable, colour_flow, flow_of, previous_frames, shrink_grey
from .options import FlowOptions
from .stage import Reading, Render, SimView, StageResult, encoded_frames, frames_inputs, sim_reading

UNIT = "px at map resolution, x right, y down, at the pixels of the previous frame"


@dataclass(frozen=True)
class FlowStage:
    """See stage.Stage. `render` serves source "sim" without stored depth."""

    options: FlowOptions
    camera: str = HEAD
    render: Render | None = None

    name = "flow"
    version = 2
    uses_models = False

    def parameters(self) -> dict[str, Any]:
        o, names = self.options, ["source", "stride", "size", "colour"]
        names += ["farneback"] if o.source == "farneback" else []
        values = asdict(o) | {"size": list(o.size)}
        return {"camera": self.camera, **{name: values[name] for name in names}}

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        if self.options.source == "sim":
            inputs, view, _ = sim_reading(episode, self.camera, True, self.render)
            bodies = episode.read().log.late(episode.meta.drawing.latency).poses
            return Reading(inputs, lambda: (view(), bodies))
        frames, size = encoded_frames(episode, self.camera), self.options.size
        return Reading(
            frames_inputs(frames),
            lambda: np.stack([shrink_grey(decode_frame(data), size) for data in frames]),
        )

    def start(self) -> Callable[[Any], StageResult]:
        return self.compute

    def compute(self, data: Any) -> StageResult:
        o = self.options
        if o.source == "sim":
            view: SimView = data[0]
            flow = exact_flows(view, data[1], o.stride, o.size)
        else:
            flow = flow_of(data, o.stride, o.farneback)
        rgb, scale = colour_flow(flow, o.colour)
        previous = previous_frames(len(flow), o.stride)
        arrays = {"flow": flow.astype(np.float16), "rgb": rgb, "scale": scale, "previous": previous}
        return StageResult(arrays, {"unit": UNIT})


def body_motions(bodies_a: Floats, bodies_b: Floats, camera_a: Floats, camera_b: Floats) -> Floats:
    """Matrices (B+1,4,4) from OpenCV's camera coordinates (m) of frame a to those of frame b;
    row 0 is the still world. World poses: `bodies_*` (B,7), `camera_*` (7,).
    """
    e_a, e_b = np.eye(4), np.eye(4)
    e_a[:3], e_b[:3] = extrinsics_cv(camera_a), extrinsics_cv(camera_b)
    moves = np.concatenate([np.eye(4)[None], matrix(bodies_b) @ matrix(inverse(bodies_a))])
    return e_b @ moves @ np.linalg.inv(e_a)


def pixel_rays(shape: Sequence[int], k: Floats) -> Floats:
    """Rays (H,W,3) through the centres of pixels, with z = 1; `shape` is (H,W)."""
    height, width = shape
    u, v = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    x, y = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    return np.stack(np.broadcast_arrays(x, y, np.ones((height, width))), -1)


def exact_flow(depth: Floats, segmentation: Pixels, k: Floats, motions: Floats) -> Floats32:
    """Flow (H,W,2) px at the pixels of frame a, x right and y down.

    `depth` (H,W) m (0 = nothing hit), `segmentation` (H,W) body index + 1, `k` (3,3). Points that
    end behind the camera get zero.
    """
    flow, infinite = np.zeros((*depth.shape, 2), np.float32), depth == 0
    z, rays = np.where(infinite, 1.0, depth), pixel_rays(depth.shape, k)
    for label in np.unique(segmentation):
        # a point at infinity has no translation and hangs on no body
        for far, m in ((False, motions[label]), (True, motions[0])):
            here = (segmentation == label) & (infinite == far)
            # the image of what stays put in a still camera is zero exactly, whatever the rounding
            # of depth
            if np.abs(m - np.eye(4)).max() < 1e-12 or not here.any():
                continue
            moved = (rays[here] * z[here][:, None]) @ m[:3, :3].T + (0.0 if far else m[:3, 3])
            front = moved[:, 2] > 1e-6
            safe = np.where(front, moved[:, 2], 1.0)
            uv = moved[:, :2] / safe[:, None] * np.array([k[0, 0], k[1, 1]]) + k[:2, 2]
            start = np.argwhere(here)[:, ::-1] + 0.5
            flow[here] = np.where(front[:, None], uv - start, 0.0)
    return flow


def shrink_flow(flow: Floats32, size: tuple[int, int]) -> Floats32:
    """Shrink (H,W,2) px to (h,w,2) px of the small image, by area average; `size` = (width,
    height)."""
    height, width = flow.shape[:2]
    if (width, height) == size:
        return flow
    with bit_stable():
        small = cv2.resize(flow, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32) * np.array([size[0] / width, size[1] / height], np.float32)


def exact_flows(view: SimView, bodies: Floats, stride: int, size: tuple[int, int]) -> Floats32:
    """Exact flow (T,h,w,2) px at `size` of the frames (max(0, t-stride), t); body poses (T,B,7)."""
    assert view.depth is not None
    flow, cameras = np.zeros((len(view.depth), *size[::-1], 2), np.float32), view.poses
    for t, a in enumerate(previous_frames(len(flow), stride)):
        if a != t:
            motions = body_motions(bodies[a], bodies[t], cameras[a], cameras[t])
            metres = np.asarray(view.depth[a] * 1e-3, np.float64)
            exact = exact_flow(metres, view.segmentation[a], view.k, motions)
            flow[t] = shrink_flow(exact, size)
    return flow
