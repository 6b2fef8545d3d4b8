"""Images through sensors, and with effects of events."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.data.cameras import View
from pipeline.data.episode.events import Span
from pipeline.poses import Floats, Pixels
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.sensing import LIGHT, Sensing, moved

SUBFRAMES = 8  # moments of an open shutter whose light is summed, the last the frame's own


@dataclass(frozen=True)
class Lapses:
    """What events do to images at `fps`: a light goes out, a camera freezes."""

    spans: Sequence[Span]
    fps: int

    def apply(
        self,
        views: Sequence[View],
        frames: Sequence[int],
        again: Callable[[Sequence[int]], Sequence[View]],
    ) -> None:
        """Change the images of `frames`; `again` takes those of others."""
        times = np.asarray(frames, float) / self.fps
        for span in self.spans:
            rows = np.flatnonzero(span.holds(times))
            if span.event.kind == "light":
                for view in (v for v in views if span.event.shows(v.camera.name)):
                    view.rgb[rows] = _dimmed(view.rgb[rows], span.event.amount)
            if span.event.kind == "freeze" and len(rows):
                last = int(np.floor(span.start * self.fps + 1e-9))
                for view, old in zip(views, again([last]), strict=True):
                    if not span.event.shows(view.camera.name):
                        continue
                    for of in ("rgb", "depth", "segmentation"):
                        if (images := getattr(view, of)) is not None:
                            images[rows] = getattr(old, of)[0]


def _dimmed(images: Pixels, share: float) -> Pixels:
    """sRGB images with a share of their light."""
    return np.rint(images * share ** (1 / 2.2)).clip(0, 255).astype(np.uint8)


def photograph(
    drawing: Renderer,
    poses: Mapping[str, Floats],
    frames: Sequence[int],
    sensing: Sensing | None,
    lapses: Lapses,
    **wanted: bool,
) -> list[View]:
    """As `exposed`, with what events do. `wanted`: depth, segmentation."""
    views = exposed(drawing, poses, frames, sensing, **wanted)
    lapses.apply(views, frames, lambda f: exposed(drawing, poses, f, sensing, **wanted))
    return views


def exposed(
    drawing: Renderer,
    poses: Mapping[str, Floats],
    frames: Sequence[int],
    sensing: Sensing | None,
    *,
    depth: bool = False,
    segmentation: bool = False,
) -> list[View]:
    """Images by every camera, as sensors take them: late, over an open shutter, with noise. `poses`
    are (T,7) by body.
    """
    if sensing is None:
        return drawing.render(poses, frames, depth=depth, segmentation=segmentation)
    closed = np.asarray(frames, float) - sensing.sensors.latency
    views = drawing.render(moved(poses, closed), depth=depth, segmentation=segmentation)
    for k, (frame, end) in enumerate(zip(frames, closed, strict=True)):
        light = [LIGHT[view.rgb[k]] for view in views]
        if sensing.shutter:
            opened = moved(poses, end - sensing.shutter * np.arange(1, SUBFRAMES) / SUBFRAMES)
            for total, view in zip(light, drawing.render(opened), strict=True):
                for image in view.rgb:
                    total += LIGHT[image]
                total /= SUBFRAMES
        for view, collected in zip(views, light, strict=True):
            view.rgb[k] = sensing.developed(view.camera.name, frame, collected)
            if view.depth is not None and sensing.sensors.depth_noise:
                view.depth[k] = sensing.measured(view.camera.name, frame, view.depth[k])
    return views
