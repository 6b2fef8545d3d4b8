"""place_empty_cup: stand a cup on a moving coaster."""

from collections.abc import Iterator

from pipeline.tasks.contract import Draw, Limit, Placement, Region, by_name, register
from pipeline.tasks.library.domino.set_down.set_down import SetDown
from pipeline.tasks.outcome import Outcome, within


@register
class PlaceEmptyCup(SetDown):
    """Grasp an empty cup and stand it on a coaster that moves.

    Success: The base of the cup is within 3.5 cm (plane) and 1.5 cm (height) of the coaster's
    centre. The cup is upright on the coaster, and both grippers are measured open. These are the
    original's tolerances, the same for its static and dynamic versions. It does not require that
    the cup is upright, or at rest.
    """

    step_limit = 500
    target, manipulated = "coaster", "cup"
    limits = by_name(
        plane=Limit(0.035), height=Limit(0.015), tilt=Limit(0.26, unit="rad"), lift=Limit(0.03)
    )
    own_conditions = ("upright", "on_coaster", "at_rest", "released")

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        yield Placement(
            "cup",
            draw.one_of("cup"),
            Region(x=(side * 0.15, side * 0.30), y=(-0.20, 0.05), yaw=(-3.14, 3.14)),
        )
        coaster = Region(x=(side * -0.05, side * 0.10), y=(-0.20, 0.05))
        yield Placement("coaster", draw.one_of("coaster"), coaster, distances={"cup": 0.10})

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.frame("cup", "base"), o.frame("coaster", "centre"))
        return {
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_height": within(z, limit["height"]),
            "upright": o.upright("cup", limit["tilt"]),
            **o.resting("cup", "coaster"),
            "grippers_open": o.grippers_open(),
        }
