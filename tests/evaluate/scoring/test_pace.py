"""How chunks follow each other in time, in a world that only counts periods."""

import numpy as np
import pytest

from pipeline.evaluate.scoring.clock import (
    ClockError,
    drive_overlapped,
    in_turn,
    join_chunks,
    parse_clock,
)

FPS, STEPS = 15, 16


class World:
    """Records what is executed: an action a period, None where the last command is held."""

    def __init__(self, periods):
        self.periods, self.done, self.length, self.fps, self.per_period, self.asked = (
            periods,
            [],
            1,
            FPS,
            STEPS,
            [],
        )

    @property
    def ending(self):
        return "time_limit" if len(self.done) >= self.periods else ""

    def advance(self, action):
        self.done.append(float(action[0]))

    def hold(self, steps):
        self.done += [None] * round(steps / STEPS)

    def plan(self, length, delays):
        """A policy whose action for period k is k, plus a thousandth for each question; delays in
        periods."""

        def ask(committed):
            number, now = len(self.asked), len(self.done)
            self.asked.append((now, committed[:, 0].round().tolist()))
            committed[:] = -1  # what is being executed already cannot be changed
            return now + np.arange(length)[:, None] + number / 1000, delays[
                number % len(delays)
            ] / FPS

        return ask


def test_in_turn_the_robot_waits_for_every_answer():
    world = World(10)
    in_turn(world, world.plan(3, [2]))
    assert world.done == [None, None, 0.0, 1.0, 2.0, None, None, 5.001, 6.001, 7.001]


@pytest.mark.parametrize("delays", [[0], [1], [3], [2, 5, 1], [4]])
def test_overlapped_every_period_executes_the_action_that_was_planned_for_it(delays):
    world = World(60)
    drive_overlapped(world, world.plan(10, delays), "switch")
    first = delays[0]
    assert world.done[:first] == [None] * first
    assert [int(action) for action in world.done[first:]] == list(range(first, 60))
    # half of a chunk at the latest, and never while an answer is under way
    gaps = np.diff([now for now, _ in world.asked])
    assert all(gap >= delays[n % len(delays)] for n, gap in enumerate(gaps)) and gaps.max() <= max(
        5, *delays
    )


def test_the_policy_is_told_what_will_be_executed_meanwhile():
    world = World(30)
    drive_overlapped(world, world.plan(10, [3]), "rtc")
    assert world.asked[0] == (0, []) and world.asked[1] == (5, [5.0, 6.0, 7.0])


def test_a_chunk_that_is_over_too_soon_keeps_its_last_action():
    world = World(9)
    drive_overlapped(world, world.plan(2, [4]), "switch")
    assert world.done == [None] * 4 + [1.0] * 4 + [5.001]


def test_chunks_go_over_into_each_other():
    old, new = np.zeros((3, 1)), np.ones((6, 1))
    assert join_chunks(old, new, 2, "switch")[:, 0].tolist() == [1, 1, 1, 1]
    assert join_chunks(old, new, 2, "blend")[:, 0] == pytest.approx([0.25, 0.5, 0.75, 1])
    c = np.array([3, 2, 1]) / 4
    assert join_chunks(old, new, 2, "rtc")[:3, 0] == pytest.approx(
        1 - c * (np.exp(c) - 1) / (np.e - 1)
    )
    assert join_chunks(np.empty((0, 1)), new, 9, "rtc")[:, 0].tolist() == [1]


def test_names_of_overlapping_clocks():
    clock = parse_clock("async:200:rtc")
    assert (clock.name, clock.kind, clock.ms, clock.join) == ("async:200:rtc", "fixed", 200, "rtc")
    assert (
        parse_clock("async:200").join == "switch"
        and parse_clock("async:measured:blend").join == "blend"
    )
    assert parse_clock("latency:200").join is None
    for text in ("async", "async:", "async:rtc", "latency:200:rtc", "async:200:soft", "async:-1"):
        with pytest.raises(ClockError):
            parse_clock(text)
