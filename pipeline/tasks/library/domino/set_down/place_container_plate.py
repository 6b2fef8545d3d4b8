from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, by_name, register

from .set_down import SetDown


@register
class PlaceContainerPlate(SetDown):
    """Grasp a bowl or cup and set it down on a plate that moves."""

    target, manipulated = "plate", "container"
    limits = by_name(plane=Limit(0.05), height=Limit(0.03), lift=Limit(0.03))
    own_conditions = ("on_plate", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "container", "bowl", "cup", x=(side * 0.20, side * 0.28), y=(-0.10, 0.05), yaw=ANY_YAW
        )
        yield draw.place("plate", x=(side * 0.02, side * 0.08), y=(-0.15, -0.10))
