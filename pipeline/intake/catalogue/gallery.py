"""Images of object families with their frames and grasps."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.data.cameras import Camera, CameraType, look
from pipeline.html import render_page
from pipeline.intake.objects.standing import instance_of
from pipeline.poses import Pixels, Pose, pose
from pipeline.report.film_strip import encode
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.objects.colliders import ALONG_X, ALONG_Y
from pipeline.world.objects.contract import Family, Grasp
from pipeline.world.objects.geometry import at, box, cylinder
from pipeline.world.physics.body import TABLE_TOP
from pipeline.world.shapes import Material, Mesh

Image = Pixels
Part = tuple[Mesh, Material]

ON_TABLE = pose((0, 0, TABLE_TOP))
AXES = ((0.9, 0.1, 0.1), (0.1, 0.75, 0.1), (0.15, 0.3, 1.0))
MARKED = 5  # grasps of an instance that are drawn at most
FIELD_OF_VIEW = 30.0  # degrees, vertical


def _axes(frame: Pose, length: float) -> list[Part]:
    bar, turns = cylinder(length / 16, length, 6), (ALONG_X, ALONG_Y, (1, 0, 0, 0))
    return [
        (at(bar, quaternion=q).moved(frame), Material(c, 0.9))
        for q, c in zip(turns, AXES, strict=True)
    ]


def _jaws(grasp: Grasp) -> list[Part]:
    """Two fingers `width` apart, 12 mm past the tcp along +x."""
    gap, thin = grasp.width / 2 + 0.0015, 0.0012
    fingers = [at(box(0.018, thin, thin), (-0.006, y, 0)) for y in (-gap, gap)]
    palm = at(box(thin, gap, thin), (-0.024, 0, 0)), at(box(0.010, thin, thin), (-0.034, 0, 0))
    return [(m.moved(grasp.pose), Material((0.1, 0.9, 0.9), 0.9)) for m in (*fingers, *palm)]


def portrait(instance: Family, marks: bool = False, size: tuple[int, int] = (320, 240)) -> Image:
    """(H,W,3) uint8 RGB, with frames and grasps if `marks`. Raises NoRenderer."""
    shape, parts = instance.shape(), list(instance.shape().visual)
    lower, upper = shape.aabb() + ON_TABLE[:3]
    away = np.array([0.35, -0.8, 0.62])
    distance = 2.15 * float(np.linalg.norm(upper - lower))
    eye = (lower + upper) / 2 + away / np.linalg.norm(away) * distance
    if marks:
        frames = instance.frames()
        for p in frames.points.values():
            parts += _axes(p, 0.04 * distance)
        count = len(frames.grasps)
        for k in np.linspace(0, count - 1, min(MARKED, count)).astype(int):
            parts += _jaws(frames.grasps[k])
    at_eye = look(eye, -away, np.cross((0, 0, 1), -away))
    camera = Camera("portrait", CameraType(*size, FIELD_OF_VIEW), None, at_eye)
    with Renderer({"thing": parts}, (), [camera], CLEAN) as renderer:
        return renderer.render({"thing": ON_TABLE[None]})[0].rgb[0]


def write_gallery(
    path: Path, families: Sequence[str], per_family: int = 6, size: tuple[int, int] = (240, 180)
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)  # before the drawing, which takes seconds
    exhibits = defaultdict[str, list[dict[str, Any]]](list)
    for name in families:
        for instance in (instance_of(name, seed) for seed in range(per_family)):
            frames, words = instance.frames(), ", ".join(instance.words().seen[-2:])
            kinds = ", ".join(sorted({g.kind for g in frames.grasps}))
            notes = (words, f"frames: {', '.join(frames.points)}", f"grasps: {kinds}")
            drawn = (portrait(instance, marks, size) for marks in (False, True))
            images = [encode(image, quality=85) for image in drawn]
            exhibits[name].append({"images": images, "notes": notes})
    values = {"families": exhibits, "width": size[0]}
    write_atomic(path, render_page("pipeline.intake.catalogue", "gallery.html", **values).encode())


def write_portrait(name: str, path: Path) -> None:
    one = instance_of(name)
    both = np.concatenate([portrait(one, marks) for marks in (False, True)], axis=1)
    write_atomic(path, encode(both, ".png"))
