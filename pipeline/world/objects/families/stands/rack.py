"""A mug rack: a post on a foot with a peg that rises towards -y, the robot."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import WOODS, metal, painted, wood
from pipeline.world.objects.colliders import arc_of_capsules, cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, sphere, sweep
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import TALL, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape

TONES = {"wood": tuple(WOODS), "metal": ("silver", "charcoal", "gold"), "painted": COLOURS}


@register("rack")
@dataclass(frozen=True)
class Rack(Parametric):
    noun = "mug rack"

    material: str = one_of(tuple(TONES))
    height: float = between(0.22, 0.28, size=TALL)
    foot: float = between(0.065, 0.085)  # radius of the foot
    post: float = between(0.009, 0.013)  # radius of the post
    peg: float = between(0.075, 0.095)  # length of the peg
    peg_radius: float = between(0.0045, 0.006)
    rise: float = between(18, 32)  # degrees of the peg above horizontal
    colour: str = one_of(TONES, by="material")
    seed: int = texture()

    def peg_path(self) -> np.ndarray:
        """Root and tip (2,3) of the peg's axis."""
        t = np.radians(self.rise)
        root = np.array([0, -0.5 * self.post, 0.74 * self.height])
        return np.stack([root, root + self.peg * np.array([0, -np.cos(t), np.sin(t)])])

    def shape(self) -> Shape:
        skin = {
            "wood": wood(self.colour, self.seed),
            "metal": metal(self.colour),
            "painted": painted(self.colour),
        }[self.material]
        root, tip = self.peg_path()
        back = np.array([root, root + (tip - root) * [1, -1, 1]])
        knob = at(sphere(1.25 * self.post, 6, 14), (0, 0, self.height - 1.25 * self.post))
        ends = [at(sphere(1.35 * self.peg_radius, 5, 10), p) for p in (tip, back[1])]
        pegs = [sweep(np.array([root, tip]), self.peg_radius, 10), sweep(back, self.peg_radius, 10)]
        return Shape(
            visual=tuple(
                (m, skin)
                for m in (
                    cylinder(self.foot, 0.014, 32, 0.003),
                    at(cylinder(self.post, self.height - self.post - 0.014, 14), (0, 0, 0.014)),
                    knob,
                    *pegs,
                    *ends,
                )
            ),
            collision=disc(self.foot, 0.014)
            + cylinder_collider(self.post, 0.01, self.height)
            + arc_of_capsules([root, tip], self.peg_radius)
            + arc_of_capsules(back, self.peg_radius),
            mass=0.9,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        root, tip = self.peg_path()
        out = tip - root
        return standing(
            self.height,
            peg=mark(*tip, normal=out),
            peg_middle=mark(*((root + tip) / 2), normal=out),
        )
