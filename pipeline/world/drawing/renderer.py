"""Draw a state log: a pure function of meshes, poses, cameras and `Visuals`."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.cameras import Camera, View, world_poses
from pipeline.data.episode.visuals import LOOK, Visuals
from pipeline.poses import IDENTITY, Floats
from pipeline.world.looks.textures import Rgba
from pipeline.world.shapes import Parts

from .edges import smoothed, through_lens
from .engine import (
    BACKGROUND,
    PRESETS,
    Drawn,
    DrawnScene,
    EngineCasters,
    bounds,
    component,
    millimetres,
)
from .masks import Depths
from .room import shell, table_legs, table_light, table_top
from .seen import Seen
from .shadows import CASTER_CELL, NOTHING, ShadowMap, caster, look_of, sun_map
from .software.casters import SoftwareCasters
from .software.scene import Bodies, Picture, Planes, lamps_of
from .surfaces import TABLE, channel, prepared
from .vulkan import ensure_renderer, has_gpu

MAX_BODIES = 255
RASTERISER = "domino-data's rasteriser"
FURNITURE = "the furniture"  # no name of a body: those have no spaces


def is_software(preset: str, look: int = LOOK) -> bool:
    """Whether our own rasteriser draws this preset and look here."""
    return look_of(look).software and not PRESETS[preset].stock and not has_gpu()


def device_of(preset: str, look: int = LOOK) -> str:
    """The name of what draws: our rasteriser, or the Vulkan device, which is chosen then. Raises
    NoRenderer."""
    return RASTERISER if is_software(preset, look) else ensure_renderer()


class Renderer(AbstractContextManager["Renderer"]):
    """A render-only scene. `images` are textures by kind that replace drawn ones. Close it, or use
    it as a context manager.

    Segmentation numbers are positions in `visual_bodies` plus one: keep the order of
    `StateLog.bodies`. Raises ValueError for more than 255 bodies, NoRenderer.

    With raster presets each camera has a scene of bodies in view; all share a shadow map.
    """

    def __init__(
        self,
        visual_bodies: Mapping[str, Parts],
        fixed: Parts,
        cameras: Sequence[Camera],
        visuals: Visuals,
        preset: str = "raster",
        images: Mapping[str, Rgba] | None = None,
    ) -> None:
        if len(visual_bodies) > MAX_BODIES:
            raise ValueError(f"{len(visual_bodies)} bodies: a segmentation holds {MAX_BODIES}")
        self._preset = PRESETS[preset]
        self.cameras = tuple(cameras)
        self._names = tuple(visual_bodies)
        self._moving = {name: parts for name, parts in visual_bodies.items() if parts}
        solid = {**self._moving, FURNITURE: [*table_legs(), *fixed]}
        self._look = look = look_of(visuals.look)
        planes: dict[str, Parts] = {
            TABLE: table_top(visuals, images),
            **shell(visuals, not self._preset.stock, images),
        }
        planes[TABLE] = look.surface(planes[TABLE], visuals.sun_direction)
        scattered = table_light(visuals, planes[TABLE][0][1].texture)
        self._sun = visuals.sun_direction
        self._bounds = {name: bounds(parts) for name, parts in (solid | planes).items()}
        numbers = {name: i + 1 for i, name in enumerate(visual_bodies)}
        stock = self._preset.stock
        self._edges = look.edges and self._preset.edges
        self._plain = np.empty((0, 0, 3), np.uint8)
        shown = solid if stock else {name: look.prepare(parts) for name, parts in solid.items()}
        self._shadows: ShadowMap[Any] | None = None
        self._scenes: Sequence[DrawnScene | Picture]
        casters = ({}, ())
        if self._preset.shadow:
            casters = self._moving, [*planes[TABLE], *solid[FURNITURE]]
        if is_software(preset, visuals.look):
            meshes = {name: caster(parts, CASTER_CELL) for name, parts in casters[0].items()}
            still = caster(casters[1], CASTER_CELL) if casters[1] else None
            of_sun = partial(SoftwareCasters, meshes, still, sun_map(self._sun))
            self._shadows = shadows = ShadowMap(visuals, casters[0], of_sun)
            lights, drawn = lamps_of(visuals, scattered), Bodies(shown, numbers)
            kinds = {camera.type: Planes(planes, camera.type) for camera in cameras}
            self._scenes = [Picture(c.type, drawn, kinds[c.type], lights, shadows) for c in cameras]
            return
        ensure_renderer()
        import sapien  # after the driver is chosen

        bodies = {
            name: Drawn(component(sapien, parts, stock), numbers.get(name, BACKGROUND))
            for name, parts in shown.items()
        }
        if stock:
            room = {name: Drawn(component(sapien, parts, stock)) for name, parts in planes.items()}
            self._scenes = [DrawnScene(sapien, bodies | room, visuals, self._preset, scattered)]
            return
        of_engine = partial(EngineCasters, sapien, visuals, casters)
        self._shadows = ShadowMap(visuals, casters[0], of_engine)
        rooms = {
            kind: {
                name: Drawn(
                    component(sapien, prepared(name, parts, kind), stock, levels=1),
                    plane=channel(name),
                    roughness=parts[0][1].roughness,
                )
                for name, parts in planes.items()
            }
            for kind in dict.fromkeys(camera.type for camera in cameras)
        }
        textures = self._shadows.casters.textures
        self._scenes = [
            DrawnScene(sapien, bodies | rooms[c.type], visuals, self._preset, scattered, textures)
            for c in cameras
        ]

    def __exit__(self, *_: object) -> None:
        """Free the device memory."""
        for scene in self._scenes:
            scene.close()
        self._scenes = ()
        if self._shadows is not None:
            self._shadows.casters.close()
        self._shadows = None

    close = __exit__

    def render(
        self,
        body_poses: Mapping[str, ArrayLike],
        frames: Sequence[int] | None = None,
        depth: bool = False,
        segmentation: bool = False,
    ) -> list[View]:
        """Views by camera at the given frames (default: all).

        `body_poses` are world poses (T,7). RGB (F,H,W,3) is uint8, depth (F,H,W) uint16 in mm along
        the viewing axis (0: nothing), segmentation (F,H,W) uint8. Raises KeyError for a missing
        body.
        """
        needed = {*self._moving, *(c.link for c in self.cameras if c.link is not None)}
        poses = {
            name: np.asarray(body_poses[name], float) for name in self._names if name in needed
        }
        index = np.asarray(frames or [0], int)
        if poses and frames is None:
            index = np.arange(len(next(iter(poses.values()))))
        poses = {name: p[index] for name, p in poses.items()}
        views = list[View]()
        for camera in self.cameras:
            shape = (len(index), camera.type.height, camera.type.width)
            rgb = np.empty((*shape, 3), np.uint8)
            far = np.empty(shape, np.uint16) if depth else None
            bodies = np.empty(shape, np.uint8) if segmentation else None
            at = world_poses(camera, poses, len(index))
            views.append(View(camera, at, rgb, far, bodies))
        poses = {name: self._look.rounded(p) for name, p in poses.items()}
        places = [world_poses(c, poses, len(index)) for c in self.cameras]
        seen = list[Seen]()
        if self._shadows is not None:
            self._shadows.follow(poses)
            still = np.repeat(IDENTITY[None], len(index), 0)
            placed = np.stack([poses[n] if n in self._moving else still for n in self._bounds], 1)
            centres, halves = (np.stack(part) for part in zip(*self._bounds.values(), strict=True))
            seen = [
                Seen(c.type, at, placed, (centres, halves), self._sun)
                for c, at in zip(self.cameras, places, strict=True)
            ]
        buffers = list[Callable[[], Depths] | None]([None] * len(views))
        for k in range(len(index)):
            now = {name: poses[name][k] for name in self._moving}
            if self._shadows is None:
                for view, at in zip(views, places, strict=True):
                    self._read(self._take(self._scenes[0], view, at[k], now), view, k)
                continue
            changed = self._shadows.draw(k) if self._preset.shadow else NOTHING
            taken = list[tuple[Any, Any] | None]()
            for i, (scene, view, watched) in enumerate(zip(self._scenes, views, seen, strict=True)):
                if watched.same(k, changed, buffers[i]):
                    taken.append(None)
                    continue
                shown = [
                    name
                    for name, here in zip(self._bounds, watched.visible[k], strict=True)
                    if here
                ]
                scene.show(shown)
                here = {name: now[name] for name in shown if name in now}
                taken.append(cameras := self._take(scene, view, places[i][k], here))
                buffers[i] = partial(cameras[0].get_picture, "GbufferDepth")
            # All are under way before the first is waited for.
            for cameras, view in zip(taken, views, strict=True):
                if cameras is not None:
                    self._read(cameras, view, k)
                    continue
                for images in (view.rgb, view.depth, view.segmentation):
                    if images is not None:
                        images[k] = images[k - 1]
        return views

    def _take(
        self, scene: DrawnScene | Picture, view: View, at: Floats, poses: Mapping[str, Floats]
    ) -> tuple[Any, Any]:
        """Start drawing a frame from `at` (7,); returns the components that hold the images."""
        for name, pose in poses.items():
            scene.place(name, pose)
        kind, truth = view.camera.type, view.depth is not None or view.segmentation is not None
        if self._preset.stock:
            camera = scene.take(kind, "rt", at)
            return camera, scene.take(kind, "masks", at) if truth else camera
        camera = scene.take(kind, "raster_masks" if truth else "raster", at)
        return camera, camera

    def _read(self, cameras: tuple[Any, Any], view: View, k: int) -> None:
        image = cameras[0].get_picture("Color" if self._preset.stock else "Image")
        if image.dtype != np.uint8:
            image = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
        if self._edges:
            if self._plain.shape != view.rgb[k].shape:
                self._plain = np.empty_like(view.rgb[k])
            smoothed(image, self._plain)
            through_lens(self._plain, view.rgb[k])
        else:
            cv2.cvtColor(image, cv2.COLOR_RGBA2RGB, dst=view.rgb[k])
        if view.depth is not None:
            view.depth[k] = millimetres(cameras[1].get_picture("GbufferDepth"))
        if view.segmentation is not None:
            view.segmentation[k] = cameras[1].get_picture("Body")[..., 0]
