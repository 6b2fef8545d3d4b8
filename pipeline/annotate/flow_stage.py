"""The flow stage: per episode flow (T,h,w,2) fp16 px, rgb (T,h,w,3), scale (T,), previous (T,)
frame index."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.flow import colour_flow, flow_of, previous_frames, shrink_grey
from pipeline.annotate.options import FlowOptions
from pipeline.annotate.sim_flow import exact_flows
from pipeline.annotate.stage import (
    Reading,
    Render,
    SimView,
    StageResult,
    encoded_frames,
    frames_inputs,
    sim_reading,
)
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.jpeg import decode_frame
from pipeline.data.names import HEAD


@dataclass(frozen=True)
class FlowStage:
    """See pipeline.annotate.stage.Stage. `render` is used by source "sim" for episodes that store
    no depth and segmentation."""

    options: FlowOptions
    camera: str = HEAD
    render: Render | None = None

    name = "flow"
    version = 2
    uses_models = False

    def parameters(self) -> dict[str, Any]:
        o = self.options
        plain = {
            "camera": self.camera,
            "source": o.source,
            "stride": o.stride,
            "size": list(o.size),
            "colour": asdict(o.colour),
        }
        return plain | ({"farneback": asdict(o.farneback)} if o.source == "farneback" else {})

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        if self.options.source == "sim":
            inputs, view, _ = sim_reading(episode, self.camera, True, self.render)
            bodies = episode.read().log.late(episode.meta.drawing.latency).poses
            return Reading(inputs, lambda: (view(), bodies))
        frames = encoded_frames(episode, self.camera)
        size = self.options.size
        return Reading(
            frames_inputs(frames),
            lambda: np.stack([shrink_grey(decode_frame(data), size) for data in frames]),
        )

    def start(self) -> Callable[[Any], StageResult]:
        return self.compute

    def compute(self, data: Any) -> StageResult:
        """Result from grey frames (T,h,w) (farneback) or a SimView and body poses (T,B,7) (sim)."""
        o = self.options
        if o.source == "sim":
            view: SimView = data[0]
            assert view.depth is not None
            flow = exact_flows(
                view.depth, view.segmentation, data[1], view.poses, view.k, o.stride, o.size
            )
        else:
            flow = flow_of(data, o.stride, o.farneback)
        rgb, scale = colour_flow(flow, o.colour)
        arrays = {
            "flow": flow.astype(np.float16),
            "rgb": rgb,
            "scale": scale,
            "previous": previous_frames(len(flow), o.stride),
        }
        return StageResult(
            arrays,
            {"unit": "px at map resolution, x right, y down, at the pixels of the previous frame"},
        )
