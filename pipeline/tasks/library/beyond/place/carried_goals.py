from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, register
from pipeline.tasks.library.domino.set_down.set_down import PlaceContainerPlate, PlaceEmptyCup


@register
class LoadBeltPlate(PlaceContainerPlate):
    """Grasp a bowl or cup and set it down on a plate that rides on a conveyor belt."""

    motion = "conveyor"


@register
class PlaceCupTurntable(PlaceEmptyCup):
    """Grasp an empty cup and stand it on a coaster that a turntable carries round."""

    motion = "turntable"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("cup", x=(side * 0.26, side * 0.32), y=(-0.20, 0.05), yaw=ANY_YAW)
        yield draw.place(
            "coaster", x=(side * 0.02, side * 0.10), y=(-0.20, 0.05), distances={"cup": 0.16}
        )
