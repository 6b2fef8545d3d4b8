from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.tasks.library.domino.set_down.place_container_plate import PlaceContainerPlate
from pipeline.tasks.library.domino.set_down.place_empty_cup import PlaceEmptyCup


@register
class LoadBeltPlate(PlaceContainerPlate):
    """Grasp a bowl or cup and set it down on a plate that rides on a conveyor belt.

    Success: as `place_container_plate`."""

    motion = "conveyor"


@register
class PlaceCupTurntable(PlaceEmptyCup):
    """Grasp an empty cup and stand it on a coaster that a turntable carries round.

    Success: as `place_empty_cup`."""

    motion = "turntable"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield Placement(
            "cup",
            draw.one_of("cup"),
            Region(x=(side * 0.26, side * 0.32), y=(-0.20, 0.05), yaw=(-3.14, 3.14)),
        )
        coaster = Region(x=(side * 0.02, side * 0.10), y=(-0.20, 0.05))
        yield Placement("coaster", draw.one_of("coaster"), coaster, distances={"cup": 0.16})
