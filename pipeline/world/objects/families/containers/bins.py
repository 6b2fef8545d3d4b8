"""Hollow boxes and bins: two baskets, a small bin, and two beside the table."""

from dataclasses import replace

import numpy as np

from pipeline.world.looks.materials import fabric, metal, plastic, wrapped
from pipeline.world.shapes import Mesh, Shape, deferred, seen_along

from ...colliders import arc_of_capsules, tray, vessel
from ...contract import NamedFrames, register
from ...geometry import at, box, loft, revolve, rounded_rectangle, stacked, sweep, tapered
from ...grasping import TILTED, bar_pinches, box_pinches, rim_pinches, turned
from ...kit import (
    COLOURS,
    LARGE,
    WIDE,
    Parametric,
    between,
    hollow,
    lean,
    listed,
    mark,
    one_of,
    texture,
)

WALL = 0.006
WEAVE = 0.056  # m: a tile of wicker, eight strands
TONES = listed("tan, brown, beige, gold, rust, white, gray, charcoal, red, teal, navy, mint, pink")


def open_box(hx: float, hy: float, height: float, wall: float, corner: float) -> Mesh:
    outline = rounded_rectangle(hx, hy, corner, 4)
    sx, sy = (hx - wall) / hx, (hy - wall) / hy
    levels = [(0, 1, 1), (height, 1, 1), (height, sx, sy), (wall, sx, sy)]
    return in_metres(loft(stacked(outline, levels), crease=40), outline)


@deferred
def in_metres(mesh: Mesh, path: np.ndarray) -> Mesh:
    """The mesh of an open box over the closed outline `path` (K,2), its uvs in tiles of WEAVE, of
    which a whole number goes round."""
    assert mesh.uvs is not None
    steps = np.linalg.norm(np.diff(np.vstack([path, path[:1]]), axis=0), axis=1)
    way = np.concatenate([[0], np.cumsum(steps)])
    whole = round(way[-1] / WEAVE)
    u = np.interp(mesh.uvs[:, 0] * len(path), np.arange(len(way)), way) / way[-1] * whole
    upright = np.abs(mesh.normals[:, 2]) < 0.9
    flat = mesh.vertices[:, :2] / WEAVE
    uvs = np.where(upright[:, None], np.column_stack([u, -mesh.vertices[:, 2] / WEAVE]), flat)
    return replace(mesh, uvs=uvs.astype(np.float32))


@deferred
def wound(tube: Mesh, path: np.ndarray) -> Mesh:
    """A tube along `path` (N,3) with four turns of cord every 4 cm."""
    assert tube.uvs is not None
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    v = np.interp((1 - tube.uvs[:, 1]) * (len(path) - 1), np.arange(len(path)), way)
    v = v / way[-1] * max(round(way[-1] / 0.04), 1)
    return replace(tube, uvs=np.column_stack([tube.uvs[:, 0], v]).astype(np.float32))


def corded_rim(outline: np.ndarray, z: float, radius: float) -> Mesh:
    path = np.column_stack([outline, np.full(len(outline), z)])
    return wound(sweep(path, radius, 6, closed=True), np.concatenate([path, path[:1]]))


@register("basket")
class Basket(Parametric):
    """Long along x, with an arched handle over its middle from -y to +y."""

    colour: str = one_of(TONES)
    hx: float = between(0.105, 0.125, size=LARGE)  # half extent along x
    hy: float = between(0.062, 0.078)
    height: float = between(0.06, 0.085)
    arch: float = between(0.165, 0.2)  # height of the handle's top
    grip: float = between(0.006, 0.008)  # radius of the handle
    handle_colour: str = one_of(TONES, other_than="colour", says="handle")
    seed: int = texture()

    def arch_path(self) -> np.ndarray:
        """Axis of the handle (N,3)."""
        angle = np.radians(np.linspace(180, 0, 11))
        low, top = 0.75 * self.height, self.arch - self.grip
        y = (self.hy - 0.5 * WALL) * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.75
        return np.column_stack([np.zeros(11), y, low + (top - low) * np.abs(np.sin(angle)) ** 0.6])

    def shape(self) -> Shape:
        path = self.arch_path()
        body = open_box(self.hx, self.hy, self.height, WALL, 0.02)
        rim = rounded_rectangle(self.hx - 0.002, self.hy - 0.002, 0.02, 4)
        band = wrapped("cord", self.handle_colour, self.seed, 0.6, 64)
        return Shape(
            (
                (body, wrapped("wicker", self.colour, self.seed, 0.7)),
                (corded_rim(rim, self.height, 0.0045), band),
                (wound(sweep(path, self.grip, 8), path), band),
            ),
            tray(self.hx, self.hy, WALL, self.height)
            + tuple(replace(c, weight=0.3) for c in arc_of_capsules(path, self.grip)),
            mass=0.3 * (self.hx * self.hy) / (0.095 * 0.07),
        )

    def frames(self) -> NamedFrames:
        bar, places = self.arch - self.grip, [-0.012, 0.0, 0.012]
        rolls = (-45, -30, -15, 0, 15, 30, 45)
        handle = bar_pinches(places, self.grip, bar, rolls=rolls, kind="handle")
        return hollow(
            self.arch,
            WALL,
            turned(handle, np.pi / 2),
            handle=mark(0, 0, bar),
            left=mark(-0.56 * self.hx, 0, WALL),
            right=mark(0.56 * self.hx, 0, WALL),
            rim=mark(0, 0, self.height),
        )


@register("bread_basket")
class BreadBasket(Parametric):
    colour: str = one_of(TONES)
    hx: float = between(0.085, 0.115, size=LARGE)
    hy: float = between(0.062, 0.08)
    height: float = between(0.034, 0.05)
    corner: float = between(0.012, 0.035)
    cloth: str = one_of(TONES, other_than="colour")  # colour of the cloth inside
    seed: int = texture()

    def shape(self) -> Shape:
        body = open_box(self.hx, self.hy, self.height, WALL, self.corner)
        rim = rounded_rectangle(self.hx - 0.003, self.hy - 0.003, self.corner, 4)
        cloth = box(0.94 * (self.hx - WALL), 0.94 * (self.hy - WALL), 0.0008)
        cloth = seen_along(at(cloth, (0, 0, WALL + 0.0008)), np.eye(2, 3), 0.05)
        band = wrapped("cord", self.colour, self.seed, 0.6, 64)
        return Shape(
            (
                (body, wrapped("wicker", self.colour, self.seed, 0.7)),
                (corded_rim(rim, self.height - 0.002, 0.004), band),
                (cloth, fabric(self.cloth, self.seed + 1)),
            ),
            tray(self.hx, self.hy, WALL, self.height),
            mass=0.22 * self.hx * self.hy / 0.007,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        hx, hy, hz = 0.5 * self.hx, WALL / 2, self.height / 2
        places = ((0, y, hz) for y in (self.hy - hy, hy - self.hy))
        front, back = (box_pinches(hx, hy, hz, at, axes="y", kind="rim") for at in places)
        return hollow(self.height, WALL, front + back)


@register("table_bin")
class TableBin(Parametric):
    radius: float = between(0.05, 0.065, size=LARGE)  # at the rim
    material: str = one_of(("plastic", "metal"))
    colour: str = one_of(COLOURS)
    foot: float = between(0.72, 0.9, of="radius")
    height: float = between(0.1, 0.135)
    stripe: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.004
        skin = plastic if self.material == "plastic" else metal
        outside, inside = tapered(f, r, h, wall, 26)
        low, top = (r + 0.002, h - 0.006), (r + 0.002, h)
        lip = revolve([(r - 0.0005, h - 0.006), low, top, (r - 0.001, h + 0.0005)], 26)
        stripe = revolve([(f + (r - f) * s + 0.0005, h * s) for s in (0.2, 0.45)], 26)
        return Shape(
            (
                (outside, skin(self.colour)),
                (inside, plastic("charcoal")),
                (lip, skin(self.stripe)),
                (stripe, skin(self.stripe)),
            ),
            vessel(f, wall, h, 16, r),
            mass=1100 * wall * np.pi * (f * f + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        flare = lean(r - self.foot, h)
        rim = rim_pinches(r, 0.004, h, 0.015, flare=flare, pitches=TILTED)
        return hollow(h, 0.004, rim)


@register("dustbin")
class Dustbin(Parametric):
    """Stands on the floor."""

    radius: float = between(0.19, 0.22, size=WIDE)
    colour: str = one_of(COLOURS)
    foot: float = between(0.82, 0.95, of="radius")
    height: float = between(0.5, 0.62)
    rim: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.008
        outside, inside = tapered(f, r, h, wall, 32)
        lip = [(r - 0.002, h - 0.03), (r + 0.004, h - 0.03), (r + 0.004, h), (r - wall, h + 0.001)]
        body, rim = (outside, plastic(self.colour)), (revolve(lip, 32), plastic(self.rim))
        pieces = vessel(f, wall, h, 20, r)
        return Shape((body, (inside, plastic("charcoal")), rim), pieces, mass=2.5)

    def frames(self) -> NamedFrames:
        return hollow(self.height, 0.008)


@register("big_bin")
class BigBin(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.18, 0.22)
    hy: float = between(0.2, 0.27)
    height: float = between(0.46, 0.58, size=("low", "medium-sized", "tall"))
    corner: float = between(0.02, 0.06)
    rim: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        wall = 0.01
        body = open_box(self.hx, self.hy, self.height, wall, self.corner)
        ring = rounded_rectangle(self.hx - 0.002, self.hy - 0.002, self.corner, 4)
        path = np.column_stack([ring, np.full(len(ring), self.height - 0.004)])
        rim = sweep(path, 0.008, 6, closed=True)
        plate = at(box(0.4 * self.hx, 0.001, 0.05, 0.0), (0, -self.hy - 0.001, 0.72 * self.height))
        return Shape(
            ((body, plastic(self.colour)), (rim, plastic(self.rim)), (plate, plastic(self.rim))),
            tray(self.hx, self.hy, wall, self.height),
            mass=3.5,
        )

    def frames(self) -> NamedFrames:
        return hollow(self.height, 0.01)
