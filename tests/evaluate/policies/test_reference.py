"""Where the interceptor believes it will meet the target: a fixed point of rehearsals, without the
simulator."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.episode.events import EventSpec
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.policies import rehearsal
from pipeline.evaluate.policies.rehearsal import Rehearsal, rehearse
from pipeline.stages.scene import build_scene

SCENE, FPS = SimpleNamespace(), 15


def ahead(seconds):
    return np.array([0.0, 0.3 - 0.1 * seconds, 0.74, 1, 0, 0, 0])


def rehearsing(monkeypatch, reachable):
    """Rehearsals that take 1 s and 4 s a metre of y, where `reachable(y)` holds; the aims asked
    for."""
    aims = []

    def rehearse(scene, aim, fps):
        aims.append(aim[1])
        return (
            Rehearsal(aim, np.zeros((1, 14)), 0, 1 + 4 * aim[1], {}) if reachable(aim[1]) else None
        )

    monkeypatch.setattr(rehearsal, "rehearse", rehearse)
    return aims


def test_the_plan_is_for_where_the_target_is_when_the_robot_is_there(monkeypatch):
    rehearsing(monkeypatch, lambda y: True)
    plan = rehearsal.meeting_plan(SCENE, FPS, ahead)
    # y = 0.3 - 0.1 (1 + 4 y)
    assert plan.aim[1] == pytest.approx(0.2 / 1.4, abs=0.002)


def test_a_first_guess_out_of_reach_is_not_the_end(monkeypatch):
    aims = rehearsing(monkeypatch, lambda y: y > 0.11)
    plan = rehearsal.meeting_plan(SCENE, FPS, ahead)
    assert aims[:2] == pytest.approx([0.1, 0.2])
    assert plan.aim[1] == pytest.approx(0.2 / 1.4, abs=0.002)


def test_what_cannot_be_reached_has_no_plan(monkeypatch):
    aims = rehearsing(monkeypatch, lambda y: False)
    assert rehearsal.meeting_plan(SCENE, FPS, ahead) is None
    assert len(aims) == len(rehearsal.FIRST_GUESSES)


def test_a_swapped_body_at_the_same_place_has_a_rehearsal_of_its_own():
    spec = EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 3)
    scene = build_scene(spec, Rules(events=(EventSpec(kind="swap"),)))
    swapped = scene.give_roles({"bell": "event_swap", "event_swap": "bell"})
    aim = scene.bodies["bell"].pose
    one, two = (rehearse(each, aim, 15) for each in (scene, swapped))
    assert one and two and one.actions.tobytes() != two.actions.tobytes()
