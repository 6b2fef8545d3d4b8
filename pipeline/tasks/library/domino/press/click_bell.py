"""click_bell: ring a moving service bell."""

from collections.abc import Iterator

from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import Draw, Limit, Placement, Region, by_name, register
from pipeline.tasks.library.domino.press.press import Press


@register
class ClickBell(Press):
    """Press the button of a moving bell with the closed fingers of the arm beside it.

    Success: A finger of the acting arm, with the gripper closed, touched the bell within 2.0 cm
    (plane, per axis) and 2.4 cm (height) of its button. This is the tighter of the original's two
    tolerances, at every level. The original moves the body's origin to the contact point, which
    shifts the button. Here the motion is the body's, and the button moves with it.
    """

    target = "bell"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(plane=Limit(0.02), height=Limit(0.024))

    def layout(self, draw: Draw) -> Iterator[Placement]:
        region = Region(x=(-0.21, 0.21), y=(-0.20, 0.10), away_from_centre=0.05)
        yield Placement("bell", draw.one_of("bell"), region)
