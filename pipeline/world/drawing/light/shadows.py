"""The sun's shadows: drawn once per frame from the shapes of the bodies and shared by all cameras
as two textures."""

from collections.abc import Iterable, Mapping, Set
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.episode.visuals import Visuals
from pipeline.world.drawing.batching import caster
from pipeline.world.drawing.light.look_versions import look_of
from pipeline.world.drawing.light.penumbra import FAR, Ground
from pipeline.world.physics.body import TABLE_HALF, TABLE_THICKNESS, TABLE_TOP
from pipeline.world.shapes import Parts

SHADER = Path(__file__).parents[1] / "shaders" / "shadow_map"
# m; this and the next three are in shaders/common/sun.glsl too
SHADOW_CENTRE = (0.0, 0.0, TABLE_TOP)
SHADOW_HALF_SIZE = 0.85  # m, across the light
SHADOW_DEPTH = 1.2  # m to both sides of the centre, along the light
SHADOW_OFFSET = 0.004  # m off the surface that is looked up
SHADOW_MAP = 448  # texels a side
CASTER_CELL = 0.004  # m, about a texel of the map
POSE_STEP = 2.0**-14  # m, far below a texel; without it bodies at rest would tremble
SAME_STILL = 16  # frames


class ShadowMap:
    """What the sun does not reach, as two `textures` that `draw` brings up to date.

    "ShadowMap" is the depth along the light, 0-1, of the far side of every body that casts a
    shadow, "ShadowMasks" the share of light, 0-1, that reaches table and floor. `moving` bodies
    follow the poses given to `follow`, on a grid of POSE_STEP; those that keep still for SAME_STILL
    frames are drawn once for all of them.
    """

    def __init__(
        self, sapien: Any, visuals: Visuals, moving: Mapping[str, Parts], fixed: Parts
    ) -> None:
        self._sapien = sapien
        render = sapien.render
        self._scene: Any = sapien.Scene([render.RenderSystem()])
        self._scene.add_directional_light(visuals.sun_direction, [1.0, 1.0, 1.0])
        self._bodies = {name: self._add(parts) for name, parts in moving.items() if parts}
        self._fixed = [self._add(fixed)[1]] if fixed else []
        # The engine keeps this setting for the whole process; a camera of several samples per pixel
        # has no depth to read.
        render.set_msaa(1)
        self._camera: Any = render.RenderCameraComponent(SHADOW_MAP, SHADOW_MAP, str(SHADER))
        entity = sapien.Entity()
        entity.add_component(self._camera)
        entity.add_to_scene(self._scene)
        table, floor = (plane_depths(height, visuals.sun_direction) for height in (TABLE_TOP, 0.0))
        self._ground = Ground(table, floor, 2 * SHADOW_DEPTH, table_window(visuals.sun_direction))
        self._masks_of = look_of(visuals.look).masks
        self._poses: dict[str, NDArray[np.float64]] = {}
        self._movers: list[frozenset[str]] = []
        self._still = far = np.ones((SHADOW_MAP, SHADOW_MAP), np.float32)
        self._depths: Any = render.RenderTexture(far, 2, "R32Sfloat", 1, "nearest", "edge")
        lit = self._light(far)
        kind = {2: "R8G8Unorm", 4: "R8G8B8A8Unorm"}[lit.shape[2]]
        self._masks: Any = render.RenderTexture(lit, 2, kind, 1, "linear", "edge")
        self.textures = {"ShadowMap": self._depths, "ShadowMasks": self._masks}

    def follow(self, poses: Mapping[str, NDArray[np.float64]]) -> None:
        """Take the poses (F,7) of the moving bodies at the frames to come."""
        self._poses = {name: np.rint(poses[name] / POSE_STEP) * POSE_STEP for name in self._bodies}
        frames = max((len(p) for p in self._poses.values()), default=1)
        self._movers = [
            frozenset(
                name
                for name, p in self._poses.items()
                if np.ptp(p[k : k + SAME_STILL], axis=0).any()
            )
            for k in range(0, frames, SAME_STILL)
        ]

    def draw(self, k: int) -> None:
        """Bring the textures up to date with frame `k` of those to come, in order from 0."""
        movers = self._movers[k // SAME_STILL]
        if k % SAME_STILL == 0:
            self._place(self._bodies.keys() - movers, k)
            self._show(self._bodies.keys() - movers, fixed=True)
            self._still = self._take().copy()
            self._show(movers, fixed=False)
        elif not movers:
            return
        depths = self._still
        if movers:
            self._place(movers, k)
            depths = np.minimum(self._take(), self._still)
        self._depths.upload(depths[..., None])
        self._masks.upload(self._light(depths))

    def close(self) -> None:
        """Free the device memory."""
        self._bodies.clear()
        self._fixed.clear()
        self._scene.clear()

    def _light(self, depths: NDArray[np.float32]) -> NDArray[np.uint8]:
        return self._masks_of(depths, self._ground)

    def _place(self, names: Iterable[str], k: int) -> None:
        for name in names:
            pose = self._poses[name][k]
            self._bodies[name][0].set_pose(self._sapien.Pose(pose[:3], pose[3:]))

    def _show(self, names: Set[str], fixed: bool) -> None:
        for component in self._fixed:
            component.visibility = float(fixed)
        for name, (_, component) in self._bodies.items():
            component.visibility = float(name in names)

    def _take(self) -> NDArray[np.float32]:
        self._scene.update_render()
        self._camera.take_picture()
        return self._camera.get_picture("GbufferDepth")

    def _add(self, parts: Parts) -> tuple[Any, Any]:
        render = self._sapien.render
        mesh = caster(parts, CASTER_CELL)
        body = render.RenderBodyComponent()
        body.attach(
            render.RenderShapeTriangleMesh(
                mesh.vertices, mesh.triangles, mesh.normals, mesh.uvs, render.RenderMaterial()
            )
        )
        entity = self._sapien.Entity()
        entity.add_component(body)
        entity.add_to_scene(self._scene)
        return entity, body


def sun_axes(direction: ArrayLike) -> NDArray[np.float64]:
    """Rows (3,3): across the light twice, and along it; `sun_coordinates` in
    shaders/common/sun.glsl."""
    forward = np.asarray(direction, float) / np.linalg.norm(direction)
    right = np.cross((1.0, 0.0, 0.0) if abs(forward[0]) < 0.9 else (0.0, 1.0, 0.0), forward)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward], np.float64)


def table_window(direction: ArrayLike) -> tuple[slice, slice]:
    """Rows and columns of the map with the light from `direction` (3,) that meets the table top,
    and FAR // 2 texels around."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 0)])
    corners = signs * (*TABLE_HALF, TABLE_THICKNESS) + signs * (SHADOW_OFFSET, SHADOW_OFFSET, 0)
    x, y = (corners @ sun_axes(direction)[:2].T / SHADOW_HALF_SIZE).T
    # the map is mirrored in x
    sides = [(np.array([at.min(), at.max()]) * 0.5 + 0.5) * SHADOW_MAP for at in (y, -x)]
    rows, columns = (
        slice(max(int(a) - FAR // 2 - 2, 0), min(int(b) + FAR // 2 + 3, SHADOW_MAP))
        for a, b in sides
    )
    return rows, columns


def plane_depths(height: float, direction: ArrayLike) -> NDArray[np.float32]:
    """Depth (SHADOW_MAP, SHADOW_MAP) at which light meets z = `height` (m), at most 1; 0 if it
    never does."""
    right, up, forward = sun_axes(direction)[:, 2]
    across = ((np.arange(SHADOW_MAP) + 0.5) / SHADOW_MAP * 2 - 1) * SHADOW_HALF_SIZE
    distance = height + SHADOW_OFFSET - SHADOW_CENTRE[2]
    if abs(forward) < 1e-6:
        return np.zeros((SHADOW_MAP, SHADOW_MAP), np.float32)
    # the map is mirrored in x
    along = (distance + across[None] * right - across[:, None] * up) / forward
    return np.clip(along / SHADOW_DEPTH * 0.5 + 0.5, 0.0, 1.0).astype(np.float32)
