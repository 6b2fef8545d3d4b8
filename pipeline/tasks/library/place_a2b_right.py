"""place_a2b_right: catch a moving object and set it down to the right of another one."""

from pipeline.tasks.contract import register
from pipeline.tasks.library.place_a2b import PlaceBeside


@register
class PlaceA2bRight(PlaceBeside):
    """Catch object A while it moves and set it down on the table to the right of object B.

    Success: A rests on the table, let go by both (measured open) grippers, its origin 8 to 20 cm from B's, to the right of it and
    less than 5 cm nearer or farther, after having been lifted 3 cm. As in the original, which does not ask that A lies on the table
    at rest; there A cannot be moved at level 0.
    """

    direction = 1
