"""Alternatives, and several skills as one."""

from collections.abc import Iterator

from pipeline.expert.actor import Actor, MotionStep, Skill
from pipeline.planning.failure import PlanFailure


def first_of(*skills: Skill) -> Skill:
    """The first of the skills that can be planned now; none replaces one that fails after its first
    motion step. Raises the last one's PlanFailure."""

    def act(a: Actor) -> Iterator[MotionStep]:
        for skill in skills[:-1]:
            steps = skill(a)
            try:
                first = next(steps)
            except (PlanFailure, StopIteration):
                continue
            yield first
            yield from steps
            return
        yield from skills[-1](a)

    return act


def in_turn(*skills: Skill) -> Skill:
    """The skills one after another as one, so that the meeting may be in any of them."""

    def act(a: Actor) -> Iterator[MotionStep]:
        for skill in skills:
            yield from skill(a)

    return act
