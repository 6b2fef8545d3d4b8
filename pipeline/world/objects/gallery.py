"""Pictures of object families: one self-contained HTML page, or a contact sheet, with frames and grasps drawn in.

Rendered by SAPIEN directly (its own shaders), so that a family can be looked at without building a scene.
"""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import cv2
import numpy as np
import sapien
from numpy.typing import NDArray

from pipeline.poses import Pose, compose, frame, pose, quat_about
from pipeline.world.objects.contract import FAMILIES, Family, Grasp
from pipeline.world.objects.geometry import at, box, cylinder
from pipeline.world.shapes import Material, Mesh

Picture = NDArray[np.uint8]
Part = tuple[Mesh, Material]

AXES = ((0.9, 0.1, 0.1), (0.1, 0.75, 0.1), (0.15, 0.3, 1.0))


class Studio:
    """A table, lights and one camera; `shoot` renders parts placed on the table top at z = 0."""

    def __init__(self, width: int = 320, height: int = 240, shader: str = "default") -> None:
        sapien.render.set_camera_shader_dir(shader)
        self.scene = sapien.Scene([sapien.render.RenderSystem()])
        self.scene.set_ambient_light([0.45, 0.45, 0.45])
        self.scene.add_directional_light([-0.4, 0.7, -1], [1.6, 1.6, 1.55], shadow=True, shadow_scale=0.6, shadow_map_size=1024)
        self._add([(at(box(1.5, 1.5, 0.01), (0, 0, -0.01)), Material((0.62, 0.60, 0.57), 0.9))])
        self.camera = self.scene.add_camera("gallery", width, height, np.radians(30), 0.01, 10)

    def shoot(self, parts: Iterable[Part], eye: Sequence[float], target: Sequence[float]) -> Picture:
        """Picture (H,W,3) uint8 RGB of `parts` from `eye` looking at `target` (m)."""
        entity = self._add(parts)
        forward = np.subtract(target, eye)
        view = frame(eye, forward, np.cross((0, 0, 1), forward))
        self.camera.set_entity_pose(sapien.Pose(view[:3].tolist(), view[3:].tolist()))
        self.scene.update_render()
        self.camera.take_picture()
        color = self.camera.get_picture("Color")[..., :3]
        self.scene.remove_entity(entity)
        return np.clip(color * 255, 0, 255).astype(np.uint8)

    def _add(self, parts: Iterable[Part]) -> sapien.Entity:
        body = sapien.render.RenderBodyComponent()
        for mesh, material in parts:
            skin = sapien.render.RenderMaterial(
                base_color=[*(c**2.2 for c in material.color), 1], roughness=material.roughness, metallic=material.metallic
            )
            if material.texture is not None and mesh.uvs is not None:
                skin.base_color_texture = sapien.render.RenderTexture2D(material.texture, "R8G8B8A8Unorm", srgb=True)
            uvs = np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uvs is None else mesh.uvs
            body.attach(sapien.render.RenderShapeTriangleMesh(mesh.vertices, mesh.triangles, mesh.normals, uvs, skin))
        entity = sapien.Entity()
        entity.add_component(body)
        self.scene.add_entity(entity)
        return entity


def axes(at_pose: Pose, length: float = 0.02) -> list[Part]:
    """Red, green and blue bars along x, y and z of a frame."""
    turns = (quat_about((0, 1, 0), np.pi / 2), quat_about((1, 0, 0), -np.pi / 2), (1, 0, 0, 0))
    bar = cylinder(length / 16, length, 6)
    return [(bar.moved(compose(at_pose, pose((0, 0, 0), q))), Material(c, 0.9)) for q, c in zip(turns, AXES, strict=True)]


def jaws(grasp: Grasp, colour: tuple[float, float, float] = (0.1, 0.9, 0.9)) -> list[Part]:
    """A thin fork: two fingers `width` apart, open towards +x of the tcp."""
    gap = grasp.width / 2 + 0.0015
    pieces = [at(box(0.018, 0.0012, 0.0012), (-0.006, y, 0)) for y in (-gap, gap)]
    pieces += [at(box(0.0012, gap, 0.0012), (-0.024, 0, 0)), at(box(0.010, 0.0012, 0.0012), (-0.034, 0, 0))]
    return [(m.moved(grasp.pose), Material(colour, 0.9)) for m in pieces]


def view_of(instance: Family) -> tuple[list[float], list[float]]:
    """Eye and target that fill the picture with the instance, from the robot's side and above."""
    lower, upper = instance.shape().aabb()
    reach = float(np.linalg.norm(upper - lower)) / 2
    target = (lower + upper) / 2
    direction = np.array([0.35, -0.8, 0.62])
    return list(target + direction / np.linalg.norm(direction) * reach * 4.3), list(target)


def portrait(studio: Studio, instance: Family, marks: bool = False, grasps: int = 5) -> Picture:
    """Picture of one instance; with `marks`, its frames and up to `grasps` of its grasps."""
    parts = list(instance.shape().visual)
    if marks:
        frames = instance.frames()
        for p in frames.points.values():
            parts += axes(p)
        chosen = np.linspace(0, len(frames.grasps) - 1, min(grasps, len(frames.grasps))).astype(int)
        for k in chosen:
            parts += jaws(frames.grasps[k])
    return studio.shoot(parts, *view_of(instance))


def contact_sheet(rows: Sequence[Sequence[Picture]]) -> Picture:
    """One picture of a grid of equally large pictures."""
    return np.concatenate([np.concatenate(list(row), axis=1) for row in rows], axis=0)


def write_gallery(
    path: Path | str, families: Sequence[str] | None = None, per_family: int = 6, size: tuple[int, int] = (240, 180)
) -> None:
    """Write one HTML page: for every family, instances of seeds 0.. with words and, in a second row, their frames and grasps.

    Raises KeyError, naming the families, for an unknown one.
    """
    names = list(FAMILIES) if families is None else list(families)
    unknown = [n for n in names if n not in FAMILIES]
    if unknown:
        raise KeyError(f"no object family {unknown[0]!r}; families are {', '.join(sorted(FAMILIES))}")
    studio = Studio(*size)
    sections = []
    for name in names:
        cells = []
        for k in range(per_family):
            instance = FAMILIES[name].draw(np.random.Generator(np.random.Philox(k)))
            pictures = "".join(_inline(portrait(studio, instance, marks)) for marks in (False, True))
            cells.append(f"<figure>{pictures}<figcaption>{escape('; '.join(instance.words().seen[-2:]))}</figcaption></figure>")
        sections.append(f"<h2>{escape(name)}</h2><div>{''.join(cells)}</div>")
    style = (
        "body{font:14px sans-serif}div{display:flex;flex-wrap:wrap}figure{margin:4px;width:" + f"{size[0]}px}}img{{display:block}}"
    )
    page = f"<!doctype html><meta charset=utf-8><title>Object families</title><style>{style}</style>{''.join(sections)}"
    Path(path).write_text(page, encoding="utf-8")


def _inline(picture: Picture) -> str:
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not done:
        raise ValueError("the picture could not be encoded as JPEG")
    return f'<img src="data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}">'
