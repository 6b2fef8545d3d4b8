"""What has hold of a task's target: the one rule of physics under `contact: hold` and of the
results' time from touch to hold."""

from pipeline.tasks import Task
from pipeline.tasks.contract import TRACKING
from pipeline.world.physics.drive import Hold
from pipeline.world.robots.contract import Embodiment


def held_by(task: Task, embodiment: Embodiment) -> Hold:
    """In an interception task both fingers of one hand. In a tracking task the body that is brought
    to the target, or any link of an arm where the target itself is pressed."""
    arms = embodiment.arms
    if task.category != TRACKING:
        return Hold(
            tuple(
                tuple(frozenset({f"{side}_{name}"}) for name in arm.gripper.fingers)
                for side, arm in arms.items()
            )
        )
    if task.manipulated != task.target:
        return Hold(((frozenset({task.manipulated}),),))
    return Hold(
        ((frozenset(f"{side}_{link.name}" for side, arm in arms.items() for link in arm.links),),)
    )
