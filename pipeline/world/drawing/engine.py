"""The renderer's interface to the engine: draw calls and scenes of bodies, lights and cameras. A
draw call costs the software rasteriser about 20 us whatever it draws."""

import hashlib
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.cameras import CameraType
from pipeline.data.episode.visuals import Visuals
from pipeline.poses import Floats, Floats32, Pose
from pipeline.world.shapes import Material, Mesh, Parts, linear, merge

from .masks import Depths, Masks
from .shadows import (
    CASTER_CELL,
    SHADOW_CENTRE,
    SHADOW_DEPTH,
    SHADOW_HALF_SIZE,
    SHADOW_MAP,
    caster,
    look_of,
)


@dataclass(frozen=True)
class Preset:
    """Whether shadows are drawn and edges smoothed. `stock` are SAPIEN's own shaders, which trace
    rays: they divide light by pi and expect linear colours."""

    shadow: bool = True
    edges: bool = False
    stock: bool = False


PRESETS: dict[str, Preset] = {
    "raster": Preset(edges=True),
    "raster-fast": Preset(shadow=False),
    "rt": Preset(stock=True),
}

PATHS = 32
"""Paths of light that ray tracing follows from each pixel."""

PLAIN = -(1 << 20)
"""uvs with v at or below this hold a material and no texture coordinates, as
`shaders/common/vertex.glsl` has it."""


def by_material(parts: Parts) -> list[tuple[Mesh, Material]]:
    """The parts, merged by material in order of first appearance."""
    groups: dict[tuple[Any, ...], tuple[list[Mesh], Material]] = {}
    for mesh, m in parts:
        key = tuple(m.color), m.roughness, m.metallic, _content(m), mesh.uvs is None
        groups.setdefault(key, ([], m))[0].append(mesh)
    return [(merge(meshes), material) for meshes, material in groups.values()]


def packed(parts: Parts) -> list[tuple[Mesh, Material]]:
    """One mesh per texture, at least one. Untextured parts carry their material in their uvs and
    join the first."""
    groups: dict[tuple[Any, ...], tuple[list[Mesh], Material]] = {}
    plain: list[Mesh] = []
    one = sum(m.texture is not None for _, m in parts) < 2  # hashing takes 10 ms an episode
    for mesh, m in parts:
        if m.texture is None or mesh.uvs is None:
            plain.append(replace(mesh, uvs=np.tile(material_uv(m), (len(mesh.vertices), 1))))
        else:
            content = b"" if one else _content(m)
            groups.setdefault((m.roughness, m.metallic, content), ([], m))[0].append(mesh)
    if plain and not groups:
        return [(merge(plain), Material((1.0, 1.0, 1.0)))]
    return [
        (merge([*(() if i else plain), *meshes]), material)
        for i, (meshes, material) in enumerate(groups.values())
    ]


def material_uv(material: Material) -> Floats32:
    """A uv pair (2,): colour as 0xRRGGBB, PLAIN - (roughness * 256 + metallic), 8 bits each."""
    r, g, b, roughness, metallic = np.rint(
        np.clip([*material.color, material.roughness, material.metallic], 0, 1) * 255
    )
    return np.array([r * 65536 + g * 256 + b, PLAIN - (roughness * 256 + metallic)], np.float32)


def bounds(parts: Parts) -> tuple[Floats, Floats]:
    """Middle and half size (3,), m, of the bounding box in the body frame."""
    points = np.concatenate([mesh.vertices for mesh, _ in parts]).astype(np.float64)
    lower, upper = points.min(0), points.max(0)
    return (lower + upper) / 2, (upper - lower) / 2


def _content(material: Material) -> bytes:
    if material.texture is None:
        return b""
    return hashlib.blake2b(np.ascontiguousarray(material.texture), digest_size=16).digest()


SHADERS = Path(__file__).parent / "shaders"
NEAR, FAR = 0.02, 12.0  # m
BACKGROUND = 0  # the number of what is no body


@dataclass(frozen=True)
class Drawn:
    """A render component and its segmentation number; a plane of the room has a shadow channel and
    roughness."""

    component: Any
    number: int = BACKGROUND
    plane: int | None = None
    roughness: float = 1.0


class DrawnScene:
    """Bodies, lights and cameras made on first use. Planes are drawn last. `scattered` is light
    from the table; `textures` are for our shaders."""

    def __init__(
        self,
        sapien: Any,
        bodies: Mapping[str, Drawn],
        visuals: Visuals,
        preset: Preset,
        scattered: tuple[float, float, float],
        textures: Mapping[str, Any] | None = None,
    ) -> None:
        self._sapien, self._preset, self._textures = sapien, preset, dict(textures or {})
        self._scene: Any = sapien.Scene([sapien.render.RenderSystem()])
        self._cameras: dict[tuple[CameraType, str], Any] = {}
        self._bodies: dict[str, tuple[Any, Any]] = {}
        self._shown = frozenset(bodies)
        self._look = look_of(visuals.look)
        self._light(visuals)
        for name, body in bodies.items():
            component = body.component.clone()
            entity = _entered(sapien, self._scene, component)
            component.set_property("body", body.number)
            if body.plane is not None:
                component.shading_mode = 1
                component.set_property("plane", body.plane)
                component.set_property("points", len(visuals.points))
                component.set_property("roughness", float(body.roughness))
            elif not preset.stock:
                for channel, light in zip(("Red", "Green", "Blue"), scattered, strict=True):
                    component.set_property(f"table{channel}", light)
            self._bodies[name] = (entity, component)

    def place(self, name: str, pose: ArrayLike) -> None:
        """Set the world pose (7,) of a body."""
        self._bodies[name][0].set_pose(_sapien_pose(self._sapien, pose))

    def show(self, names: Iterable[str]) -> None:
        """Hide all other bodies. A change costs a third of a frame."""
        shown = frozenset(names)
        for name in shown ^ self._shown:
            self._bodies[name][1].visibility = float(name in shown)
        self._shown = shown

    def take(self, kind: CameraType, shader: str, pose: ArrayLike) -> Any:
        """Draw from a world pose (7,); the camera holds the image until its next one."""
        if (kind, shader) not in self._cameras:
            self._cameras[kind, shader] = self._camera(kind, shader)
        camera = self._cameras[kind, shader]
        camera.entity.set_pose(_sapien_pose(self._sapien, pose))
        self._scene.update_render()
        camera.take_picture()
        return camera

    def close(self) -> None:
        """Free the device memory."""
        self._bodies.clear()
        self._cameras.clear()
        self._scene.clear()

    def _camera(self, kind: CameraType, shader: str) -> Any:
        render = self._sapien.render
        stock = Path(self._sapien.__file__).parent / "vulkan_shader" / shader
        own = (SHADERS / (shader + self._look.shaders), SHADERS / shader)
        folder = next((path for path in own if path.is_dir()), stock)
        if shader == "rt":
            render.set_ray_tracing_samples_per_pixel(PATHS)
            render.set_ray_tracing_path_depth(8)
            render.set_ray_tracing_denoiser("none")
        for target in ("Image", "Body"):
            render.set_picture_format(target, "R8G8B8A8Unorm")
        camera = render.RenderCameraComponent(kind.width, kind.height, str(folder))
        camera.set_fovy(np.radians(kind.fovy))
        camera.near, camera.far = NEAR, FAR
        _entered(self._sapien, self._scene, camera)
        for name, texture in self._textures.items():
            camera.set_texture(name, texture)
        return camera

    def _light(self, visuals: Visuals) -> None:
        unit = np.pi if self._preset.stock else 1.0
        self._scene.set_ambient_light(visuals.ambient)
        self._scene.add_directional_light(
            visuals.sun_direction,
            np.array(visuals.sun) * unit,
            shadow=self._preset.shadow,
            position=SHADOW_CENTRE,
            shadow_scale=SHADOW_HALF_SIZE,
            shadow_near=-SHADOW_DEPTH,
            shadow_far=SHADOW_DEPTH,
            shadow_map_size=SHADOW_MAP,
        )
        for point in visuals.points:
            self._scene.add_point_light(point.position, np.array(point.color) * unit)


class EngineCasters:
    """The sun's view of bodies, and the two `textures` that our shaders look shadows up in."""

    def __init__(
        self,
        sapien: Any,
        visuals: Visuals,
        bodies: tuple[Mapping[str, Parts], Parts],
        depths: Depths,
        masks: Masks,
    ) -> None:
        self._sapien, render = sapien, sapien.render
        self._scene: Any = sapien.Scene([render.RenderSystem()])
        self._scene.add_directional_light(visuals.sun_direction, [1.0, 1.0, 1.0])
        moving, fixed = bodies
        self._bodies = {name: self._add(parts) for name, parts in moving.items() if parts}
        self._fixed = [self._add(fixed)[1]] if fixed else []
        self._camera: Any = render.RenderCameraComponent(
            SHADOW_MAP, SHADOW_MAP, str(SHADERS / "shadow_map")
        )
        _entered(sapien, self._scene, self._camera)
        self._depths: Any = render.RenderTexture(depths, 2, "R32Sfloat", 1, "nearest", "edge")
        kind = {2: "R8G8Unorm", 4: "R8G8B8A8Unorm"}[masks.shape[2]]
        self._masks: Any = render.RenderTexture(masks, 2, kind, 1, "linear", "edge")
        self.textures = {"ShadowMap": self._depths, "ShadowMasks": self._masks}

    def place(self, name: str, pose: Pose) -> None:
        """Set the world pose (7,) of a body."""
        self._bodies[name][0].set_pose(_sapien_pose(self._sapien, pose))

    def show(self, names: Set[str], fixed: bool) -> None:
        """Hide all other bodies."""
        for component in self._fixed:
            component.visibility = float(fixed)
        for name, (_, component) in self._bodies.items():
            component.visibility = float(name in names)

    def take(self, behind: Depths) -> Depths:
        """Depths of what is shown, or those behind where they are less."""
        self._scene.update_render()
        self._camera.take_picture()
        return np.minimum(self._camera.get_picture("GbufferDepth"), behind)

    def upload(self, depths: Depths, masks: Masks) -> None:
        """Look shadows up in these."""
        self._depths.upload(depths[..., None])
        self._masks.upload(masks)

    def close(self) -> None:
        """Free the device memory."""
        self._bodies.clear()
        self._fixed.clear()
        self._scene.clear()

    def _add(self, parts: Parts) -> tuple[Any, Any]:
        render = self._sapien.render
        mesh = caster(parts, CASTER_CELL)
        body = render.RenderBodyComponent()
        shape = mesh.vertices, mesh.triangles, mesh.normals, mesh.uvs, render.RenderMaterial()
        body.attach(render.RenderShapeTriangleMesh(*shape))
        return _entered(self._sapien, self._scene, body), body


def _entered(sapien: Any, scene: Any, component: Any) -> Any:
    """The entity of a component in a scene."""
    entity = sapien.Entity()
    entity.add_component(component)
    entity.add_to_scene(scene)
    return entity


def _sapien_pose(sapien: Any, pose: ArrayLike) -> Any:
    p = np.asarray(pose, float)
    return sapien.Pose(p[:3], p[3:])


def component(sapien: Any, parts: Parts, stock: bool, levels: int = 4) -> Any:
    """Render component: one draw call per texture for our shaders, per material for stock ones.
    Textures get `levels` mip levels."""
    render, body = sapien.render, sapien.render.RenderBodyComponent()
    for mesh, material in by_material(parts) if stock else packed(parts):
        color = np.asarray(material.color, float)
        surface = render.RenderMaterial(
            base_color=[*(linear(color) if stock else color), 1.0],
            specular=0.5,
            roughness=material.roughness,
            metallic=material.metallic,
        )
        uvs = np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uvs is None else mesh.uvs
        if material.texture is not None and mesh.uvs is not None:
            # an unpickled array has not the dtype object that the engine asks for, a copy has
            pixels = np.array(material.texture, np.uint8)
            surface.base_color_texture = render.RenderTexture2D(
                pixels, "R8G8B8A8Unorm", levels, "linear", "repeat", stock
            )
        shape = mesh.vertices, mesh.triangles, mesh.normals, uvs, surface
        body.attach(render.RenderShapeTriangleMesh(*shape))
    return body


def millimetres(depth_buffer: Floats32) -> NDArray[np.uint16]:
    """Depth buffer (H,W) 0-1 -> mm along the viewing axis, 0 for the background."""
    d = depth_buffer.astype(np.float64)
    z = NEAR * FAR / (FAR - d * (FAR - NEAR))
    return np.where(d < 1.0, np.rint(z * 1000.0), 0).astype(np.uint16)
