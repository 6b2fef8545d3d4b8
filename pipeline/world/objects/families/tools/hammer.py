"""A mallet standing on its striking face: the head upright over the origin, the grip level along
-x."""

from dataclasses import dataclass, replace

from pipeline.poses import pose
from pipeline.world.looks.materials import made_of, metal, painted, rubber
from pipeline.world.objects.colliders import ALONG_X, cylinder_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, revolve
from pipeline.world.objects.grasping import bar_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LONG, Parametric, between, one_of, texture
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Collider, Shape

_STEEL_TO_WOOD = 9.0
_METALS = ("silver", "charcoal", "gray")


@register("hammer")
@dataclass(frozen=True)
class Hammer(Parametric):
    grip: str = one_of(("wood", "rubber"))
    length: float = between(0.17, 0.23, size=LONG)  # of the grip, from the head's axis
    half: float = between(0.01, 0.0125)  # half thickness of the grip
    face: float = between(0.021, 0.026)  # radius of the striking face
    reach: float = between(0.066, 0.082)  # height of the head as it stands
    colour: str = one_of(
        {"wood": ("oak", "walnut", "beech", "mahogany"), "rubber": COLOURS}, by="grip"
    )
    head_colour: str = one_of((*_METALS, "red", "blue"))
    seed: int = texture()

    def shape(self) -> Shape:
        h, f, long, z = self.half, self.face, self.length, self.reach / 2
        skin = made_of(self.grip, self.colour, self.seed)
        steel = (
            metal(self.head_colour) if self.head_colour in _METALS else painted(self.head_colour)
        )
        swell = [
            (0.86 * h, 0.35 * long),
            (h, 0.62 * long),
            (0.6 * h, 0.7 * long),
            (0.6 * h, long),
            (0, long),
        ]
        butt = [
            (0, -0.002),
            (0.6 * h, -0.002),
            (1.02 * h, 0.004),
            (1.02 * h, 0.016),
            (0.9 * h, 0.018),
        ]
        ribs = (
            [(share * h, x) for x in (0.04, 0.05, 0.06) for share in (1.02, 0.88)]
            if self.grip == "rubber"
            else []
        )
        shaft = revolve([(0.86 * h, 0.018), *ribs, *swell], 12, crease=60)
        r, top = 0.82 * f, self.reach
        waist = revolve([(r, 0.016), (r, top - 0.016)], 18)
        face = [(0, 0), (f - 0.003, 0), (f, 0.003), (f, 0.011), (r, 0.016)]
        faces = join(revolve(face, 18), revolve([(x, top - y) for x, y in reversed(face)], 18))
        collar = at(cylinder(1.25 * h, 2 * r + 0.004, 12, 0.002), (-r - 0.002, 0, z), ALONG_X)
        # flat sides, as real grips have: two round pads on a round bar could not keep the head from
        # swinging
        grip = Collider("box", ((long - f) / 2, h, h), pose((-(long + f) / 2, 0, z)))
        return Shape(
            visual=(
                (at(shaft, (-long, 0, z), ALONG_X), skin),
                (at(revolve(butt, 12), (-long, 0, z), ALONG_X), rubber("black")),
                (waist, steel),
                (faces, metal("silver", self.seed)),
                (collar, steel),
            ),
            collision=(
                *(replace(c, weight=_STEEL_TO_WOOD) for c in cylinder_collider(f, 0.0, self.reach)),
                grip,
            ),
            mass=0.17 * (f / 0.0235) ** 2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        h, long, z = self.half, self.length, self.reach / 2
        return standing(
            self.reach,
            bar_pinches([-0.7 * long, -0.6 * long, -0.5 * long], h, z, kind="handle"),
            face=mark(0, 0, 0, (0, 0, -1)),
            grip=mark(-0.6 * long, 0, z),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "grip": self.colour if self.grip == "wood" else f"{self.colour} rubber",
            "hafted": "wooden-handled" if self.grip == "wood" else "rubber-handled",
            "head": self.head_colour,
        }
