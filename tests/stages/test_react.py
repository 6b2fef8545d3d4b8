"""The reactive expert in whole episodes: it knows no future, keeps the limits, and tries again."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.limits import fill
from pipeline.data.episode.state_log import StateLog
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Sight
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.reactive.controller import PERIOD, ReactiveExpert
from pipeline.expert.reactive.imagination import PACE
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.stages.failure import Failure
from pipeline.stages.replay import react
from pipeline.stages.scene import Scene, build_scene

EXACT = Sight()


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(EpisodeSpec("click_bell", "aloha-agilex", 3, 0.1, "clean", 0, 1))


def turning(scene: Scene, after: tuple[float, float], at: float = 2.0) -> PlanarMotion:
    """Along y at 4 cm/s until `at` s, then with velocity `after` (2,)."""
    start = scene.bodies["bell"].pose
    corner = np.array([start[0], start[1] + 0.04 * at])
    first = np.array([[start[0], 0.0], [start[1], 0.04 * at]])
    second = np.stack([corner, np.array(after) * (4.0 - at)], axis=1)
    pieces = (Segment(0.0, at, first), Segment(at, 4.0, second))
    return PlanarMotion(3, 0.1, 4.0, 0.0, float(start[2]), start[3:], pieces)


def recorded(scene: Scene, motion: PlanarMotion, sight: Sight) -> StateLog:
    try:
        return react(scene, motion, sight, 15).log
    except Failure as failure:
        assert failure.log is not None
        return failure.log


@pytest.mark.parametrize(
    "sight", [EXACT, Sight(delay=0.1, noise=0.005)], ids=["exact", "late and noisy"]
)
def test_futures_that_differ_give_the_same_bytes_until_they_do(scene, sight):
    one, other = (
        recorded(scene, turning(scene, after), sight) for after in ((0.1, 0.0), (-0.05, 0.05))
    )
    same = one.times <= 2.0
    for name in ("poses", "qpos", "qvel", "tcp", "state"):
        assert np.array_equal(getattr(one, name)[same], getattr(other, name)[: same.sum()]), name
    # an action is commanded after its frame: that of the frame at 2 s already answers what is seen
    # then, which is still the same
    assert np.array_equal(one.action[same], other.action[: same.sum()])
    assert not np.array_equal(one.action[: same.sum() + 30], other.action[: same.sum() + 30])


def test_where_the_target_is_to_end_makes_no_difference(scene):
    """The scene knows the manipulation pose; the expert must not."""
    motion = turning(scene, (0.0, 0.04))
    bell = scene.bodies["bell"]
    elsewhere = replace(
        scene,
        bodies={"bell": replace(bell, pose=bell.pose + np.array([0.03, -0.05, 0, 0, 0, 0, 0]))},
    )
    one, other = recorded(scene, motion, EXACT), recorded(elsewhere, motion, EXACT)
    assert np.array_equal(one.action, other.action)


def test_no_command_of_a_reactive_episode_exceeds_a_limit():
    recipe = Recipe.model_validate(
        {"tasks": ["grab_roller"], "levels": [1], "episodes": 1, "expert": "reactive"}
    )
    worst = fill((recipe, next(iter(recipe.slots()))))
    assert worst is not None
    for kind in ("velocity", "acceleration", "jerk"):
        assert 0.3 < worst.values[kind] < 1 + 1e-5, kind


def test_a_hand_that_is_off_its_path_stops_gently(scene, monkeypatch):
    """The target turns back: the hand is thrown off its path, and does not go nearer until it is
    back on it."""
    paces, act = list[float](), ReactiveExpert.act

    def watched(self, track, time, *, touched=False):
        near, before = self.near and not touched, self.row
        commands = list(act(self, track, time, touched=touched))
        paces.extend([(self.row - before) / (PACE * PERIOD)] * near)
        return iter(commands)

    monkeypatch.setattr(ReactiveExpert, "act", watched)
    react(scene, turning(scene, (0.0, -0.12), 2.4), EXACT, 15)
    assert min(paces) <= 0.0 and paces[-2] == pytest.approx(1.0)
    # 0.5: the greatest change in a control period
    assert np.abs(np.diff([1.0, *paces[:-1]])).max() == pytest.approx(0.5)


def test_a_target_that_leaps_away_is_met_all_the_same(scene):
    """It stands until the hand is about to touch it, moves 12 cm in 0.4 s and stands: the hand
    draws back and comes again."""
    bell = scene.bodies["bell"].pose
    touch = recorded(scene, PlanarMotion.still(bell, 3.0), EXACT).time_of("meeting")
    assert touch is not None
    times = (0.0, touch - 0.3, touch + 0.1, touch + 0.2)
    places = (bell[1], bell[1], bell[1] + 0.12, bell[1] + 0.12)
    pieces = [np.array([[bell[0], 0.0], [places[k], places[k + 1] - places[k]]]) for k in range(3)]
    segments = tuple(Segment(times[k], times[k + 1], piece) for k, piece in enumerate(pieces))
    motion = PlanarMotion(3, 0.5, times[-1], 0.0, float(bell[2]), bell[3:], segments)
    log = react(scene, motion, EXACT, 15).log
    met = log.time_of("meeting")
    assert met is not None and met > touch + 0.3
    tool = log.tcp[:, 0 if scene.arms["arm"] == "left" else 1, 2]
    before = log.times < touch - 0.3
    assert tool[before].min() + 0.02 < tool[(log.times > touch - 0.3) & (log.times < met)].max()
