"""load_belt_plate: set a bowl or cup down on a plate that a belt carries past."""

from pipeline.tasks.contract import register
from pipeline.tasks.library.domino.set_down.place_container_plate import PlaceContainerPlate


@register
class LoadBeltPlate(PlaceContainerPlate):
    """Grasp a bowl or cup and set it down on a plate that rides on a conveyor belt.

    Success: that of `place_container_plate`.
    """

    motion = "conveyor"
