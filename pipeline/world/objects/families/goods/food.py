"""A bun, a tin loaf, a short baguette, a square roll; a tomato on a flat underside."""

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import glaze, painted, shaded, wrapped
from pipeline.world.shapes import Material, Mesh, Shape, seen_along

from ...colliders import convex_collider, disc
from ...contract import NamedFrames, register
from ...geometry import (
    at,
    cylinder,
    ellipse,
    revolve,
    rounded_rectangle,
    scaled,
    sphere,
    stack,
    stacked,
)
from ...grasping import box_pinches, side_pinches
from ...kit import LARGE, Parametric, between, drawn, mark, one_of, size_word, standing, texture

# length over width
FORMS = {"bun": (1.0, 1.08), "loaf": (1.5, 1.9), "baguette": (2.9, 3.6), "roll": (1.05, 1.35)}
CRUSTS: dict[str, tuple[float, float, float]] = {
    "golden": (0.80, 0.55, 0.24),
    "brown": (0.58, 0.34, 0.15),
    "dark": (0.36, 0.20, 0.10),
    "pale": (0.90, 0.75, 0.50),
}
WIDTH, SLIM = (0.048, 0.064), {"baguette": 0.86}
LEVELS = (
    (
        *((0, 0.82, 0.78), (0.08, 0.94, 0.93), (0.3, 1, 1), (0.5, 1, 1), (0.72, 0.9, 0.88)),
        *((0.9, 0.66, 0.6), (1, 0.3, 0.26)),
    ),
    (
        *((0, 0.93, 0.9), (0.08, 1, 0.98), (0.5, 1, 1), (0.62, 1, 1), (0.82, 0.95, 0.9)),
        *((0.95, 0.82, 0.62), (1, 0.6, 0.3)),
    ),
)
"""Height, length and width of the rings of a piece, as shares, and of a loaf."""

# no side of the crust lies along the view
OBLIQUE = np.array([[1.0, 0.0, 0.55], [0.0, 1.0, -0.65]])


@register("bread")
class Bread(Parametric):
    form: str = one_of(tuple(FORMS))
    width: float = drawn(lambda rng, bread: rng.uniform(*WIDTH) * SLIM.get(bread.form, 1.0))
    length: float = drawn(lambda rng, bread: bread.width * rng.uniform(*FORMS[bread.form]))
    height: float = between(0.036, 0.046)
    crust: str = one_of(tuple(CRUSTS))
    shade: float = between(0.9, 1.1)
    seed: int = texture()

    def rings(self) -> np.ndarray:
        """Horizontal rings (L,K,3) of the body, from the base up."""
        a, b, h = self.length / 2, self.width / 2, self.height
        outline = ellipse(a, b, 20)
        if self.form in ("loaf", "roll"):
            corner = 0.012 if self.form == "loaf" else 0.6 * b
            outline = rounded_rectangle(a, b, corner, 4)
        return stacked(outline, [(z * h, x, y) for z, x, y in LEVELS[self.form == "loaf"]])

    def shape(self) -> Shape:
        rings = self.rings()
        crust = shaded(CRUSTS[self.crust], self.shade)
        light = shaded(crust, 1.12)
        base = rings[0, :, :2]
        levels = [(r[0, 2], *(np.ptp(r[:, :2], axis=0) / np.ptp(base, axis=0))) for r in rings]
        body = seen_along(stack(base, levels, 60), OBLIQUE, 0.07)
        meshes = self._seeds() if self.form == "bun" else self._slashes()
        marks = [(mesh, Material(light, 0.95)) for mesh in meshes]
        return Shape(
            ((body, wrapped("crust", crust, self.seed, 0.95)), *marks),
            convex_collider(rings.reshape(-1, 3)),
            mass=260 * np.pi * self.length * self.width * self.height * 0.22,
            friction=0.7,
        )

    def _slashes(self) -> list[Mesh]:
        count = {"baguette": 5, "loaf": 1, "roll": 2}[self.form]
        is_loaf = self.form == "loaf"
        size = (0.28 * self.length, 0.006) if is_loaf else (0.0045, 0.3 * self.width)
        cut = scaled(sphere(1.0, 4, 10), *size, 0.0035)
        turn = quat_about((0, 0, 1), 0.5 if self.form == "baguette" else 0.0)
        places = [(k - (count - 1) / 2) * 0.72 * self.length / count for k in range(count)]
        sag = 0.0 if is_loaf else 0.35
        tops = (self.height * (1 - sag * (2 * x / self.length) ** 2) - 0.0025 for x in places)
        return [at(cut, (x, 0, z), turn) for x, z in zip(places, tops, strict=True)]

    def _seeds(self) -> list[Mesh]:
        rng = np.random.Generator(np.random.Philox(self.seed))
        seedlet = sphere(0.0016, 3, 5)
        angle, share = rng.uniform(0, 2 * np.pi, 14), 0.62 * np.sqrt(rng.uniform(size=14))
        x, y = share * self.length / 2 * np.cos(angle), share * self.width / 2 * np.sin(angle)
        z = self.height * (1 - 0.28 * (share / 0.62) ** 2)
        return [at(seedlet, p) for p in zip(x, y, z, strict=True)]

    def frames(self) -> NamedFrames:
        half = self.length / 2, self.width / 2, self.height / 2
        heights = max(0.4 * self.height, 0.014), 0.022
        offsets = (-0.3, 0.0, 0.3) if self.form == "loaf" else (0.0,)
        axes = "xy" if self.form in ("bun", "roll") else "y"
        grasps = box_pinches(*half, heights=heights, offsets=offsets, axes=axes)
        return standing(self.height, grasps)

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "colour": self.crust,
            "size": size_word(self.width, WIDTH),
            "form": "bread roll" if self.form == "roll" else self.form,
        }


SKINS = {"ripe": ("red", "maroon"), "unripe": ("green", "lime", "mint")}


@register("tomato")
class Tomato(Parametric):
    ripeness: str = one_of(tuple(SKINS))
    colour: str = one_of(SKINS, by="ripeness")
    radius: float = between(0.025, 0.031, size=LARGE)
    height: float = between(1.55, 1.75, of="radius")

    def outline(self) -> np.ndarray:
        """Silhouette (K,2) of (radius, z) from the base to the top."""
        angle = np.radians(np.linspace(-70, 70, 11))
        z = np.sin(angle) / np.sin(angle[-1])
        return np.column_stack([self.radius * np.cos(angle), self.height / 2 * (1 + z)])

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        skin = revolve([(0, 0), *self.outline().tolist(), (0, h - 0.002)], 24, 60.0)
        leaves = at(cylinder(0.45 * r, 0.0015, 5), (0, 0, h - 0.0005))
        stem = at(cylinder(0.08 * r, 0.006, 8), (0, 0, h - 0.0025))
        green = painted("dark green")
        return Shape(
            ((skin, glaze(self.colour)), (leaves, green), (stem, green)),
            disc(r, h),
            mass=900 * 4 / 3 * np.pi * r * r * h / 2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        grasps = side_pinches(r, max(h / 2, 0.022), outline=[(r, 0.0), (r, h)])
        return standing(h, grasps, middle=mark(0, 0, h / 2))
