from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, Workspace, by_name, register

from .press import Press


@register
class ClickAlarmclock(Press):
    """Press the button of a moving alarm clock with the closed fingers of the arm beside it."""

    target = "clock"
    workspace = Workspace(-0.40, 0.40, -0.30, 0.20)
    limits = by_name(plane=Limit(0.027), height=Limit(0.027))

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "clock",
            "alarm_clock",
            x=(-0.21, 0.21),
            y=(-0.20, 0.10),
            yaw=ANY_YAW,
            away_from_centre=0.05,
        )
