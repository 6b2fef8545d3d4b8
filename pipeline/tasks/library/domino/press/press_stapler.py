from pipeline.tasks.contract import (
    ANY_YAW,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Workspace,
    by_name,
    register,
)

from .press import Press


@register
class PressStapler(Press):
    """Press the arm of a moving stapler near its mouth with the closed fingers of the arm beside
    it."""

    target, part = "stapler", "press"
    workspace = Workspace(-0.35, 0.35, -0.20, 0.20)
    limits = by_name(plane=Limit(0.027, 0.03), height=Limit(0.027, 0.03))
    own_conditions = ("closed_at_press",)

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("stapler", x=(-0.20, 0.20), y=(-0.10, 0.05), yaw=ANY_YAW)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        sides = o.log.sides if o.rules.name == "domino" else (arms["arm"],)
        presses = [o.press(side, "stapler", "press", self.under(o.rules)) for side in sides]
        return {name: any(found[name] for found in presses) for name in presses[0]}
