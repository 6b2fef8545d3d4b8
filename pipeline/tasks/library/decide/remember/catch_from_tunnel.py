from pipeline.expert.skills import pause
from pipeline.tasks.contract import Actor, Skills, register
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt

WATCHED = 1.5  # s for which the arm stays at home: the product goes into the tunnel


@register
class CatchFromTunnel(PickFromBelt):
    """Grasp a can or a bottle that comes out of a tunnel, which hides it before, and lift it.

    Success: as `pick_from_belt`."""

    motion = "tunnel"

    def meet(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], WATCHED)
        yield from super().meet(a)
