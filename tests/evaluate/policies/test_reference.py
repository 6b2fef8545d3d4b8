"""Where the interceptor believes it will meet the target: a fixed point of rehearsals, without the
simulator."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.evaluate.policies import reference
from pipeline.evaluate.policies.reference import Rehearsal

TRIAL = SimpleNamespace(scene=None, fps=15)
AT = np.array([0.0, 0.3, 0.74, 1, 0, 0, 0])
SPEED = np.array([0.0, -0.1, 0.0])


def rehearsing(monkeypatch, reachable):
    """Rehearsals that take 1 s and 4 s a metre of y, where `reachable(y)` holds; the aims asked
    for."""
    aims = []

    def rehearse(scene, aim, fps):
        aims.append(aim[1])
        return (
            Rehearsal(aim, np.zeros((1, 14)), 0, 1 + 4 * aim[1], {}) if reachable(aim[1]) else None
        )

    monkeypatch.setattr(reference, "rehearse", rehearse)
    return aims


def test_the_plan_is_for_where_the_target_is_when_the_robot_is_there(monkeypatch):
    rehearsing(monkeypatch, lambda y: True)
    plan = reference._meeting_plan(TRIAL, AT, SPEED)
    # y = 0.3 - 0.1 (1 + 4 y)
    assert plan.aim[1] == pytest.approx(0.2 / 1.4, abs=0.002)


def test_a_first_guess_out_of_reach_is_not_the_end(monkeypatch):
    aims = rehearsing(monkeypatch, lambda y: y > 0.11)
    plan = reference._meeting_plan(TRIAL, AT, SPEED)
    assert aims[:2] == pytest.approx([0.1, 0.2])
    assert plan.aim[1] == pytest.approx(0.2 / 1.4, abs=0.002)


def test_what_cannot_be_reached_has_no_plan(monkeypatch):
    aims = rehearsing(monkeypatch, lambda y: False)
    assert reference._meeting_plan(TRIAL, AT, SPEED) is None
    assert len(aims) == len(reference.FIRST_GUESSES)
