from pipeline.tasks.contract import Bodies, Draw, Limit, Workspace, by_name, register

from .press import Press


@register
class ClickBell(Press):
    """Press the button of a moving bell with the closed fingers of the arm beside it."""

    target = "bell"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(plane=Limit(0.02), height=Limit(0.024))

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("bell", x=(-0.21, 0.21), y=(-0.20, 0.10), away_from_centre=0.05)
