from pipeline.expert.skills import pause
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Draw,
    Outcome,
    Placement,
    Region,
    Skills,
    register,
)
from pipeline.tasks.library.domino.press.press import ClickBell

WATCHED = 1.2  # s for which the arms stay at home: the light has gone out by then


@register
class FollowLight(ClickBell):
    """Press the button of that one of two equal moving bells whose plate has lit up green; the
    other plate lit up red.

    Success: closed fingers touched that bell near its button, and none touched the other."""

    motion, movers = "flash", {"other": "flash_red"}

    def layout(self, draw: Draw) -> Bodies:
        bell, side = draw.one_of("bell"), draw.side()
        near = Region(x=(side * 0.06, side * 0.20), y=(-0.20, 0.05))
        yield Placement("bell", bell, near)
        anywhere = Region(x=(-0.20, 0.20), y=(-0.20, 0.10), away_from_centre=0.05)
        yield Placement("other", bell, anywhere, distances={"bell": 0.16})

    def meet(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], WATCHED)
        yield from super().meet(a)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        presses = [o.press(side, "bell", self.part, limit) for side in o.log.sides]
        best = max(presses, key=lambda press: sum(press.values()))
        other = any(o.touched(side, "other") for side in o.log.sides)
        return {**best, "other_untouched": not other}
