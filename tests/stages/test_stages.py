"""The three stages on one scene: clearance against brute force, reasons of failure, the time of
success."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.cameras import project, visible
from pipeline.data.names import SIDES
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.contract import MotionRequest
from pipeline.motion.models.planar import judge_shapes
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.planar_shapes import DRAW
from pipeline.motion.workspace import Workspace
from pipeline.planning.collision_pieces import Sweep
from pipeline.poses import compose, lifted, transform
from pipeline.stages import back_calculate as module
from pipeline.stages.back_calculate import CLOSING, EARLY, Clearance, back_calculate
from pipeline.stages.dry_run import DryRun, dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.replay import replay
from pipeline.stages.scene import build_scene, success_time
from pipeline.world.cameras import cameras_of
from pipeline.world.physics.body import TABLE_TOP
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Simulation


@pytest.fixture(scope="module")
def prepared():
    """A scene of click_bell at level 1 and its dry run."""
    for seed in range(6):
        scene = build_scene(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, seed))
        try:
            return scene, dry_run(scene, 15)
        except Failure:
            continue
    raise AssertionError("six dry runs failed")


def straight(scene, dry, offset):
    """Ends at the bell's place at the meeting, having begun at `offset` (2,) from it."""
    end = scene.bodies["bell"].pose
    c = np.array([[end[i] + offset[i], -offset[i]] for i in range(2)])
    return PlanarMotion(
        1, 0.5, dry.meeting, 0.0, float(end[2]), end[3:], (Segment(0.0, dry.meeting, c),)
    )


@pytest.mark.parametrize("level", [2, 3])
def test_a_target_is_met_at_three_times_alpha_at_most(monkeypatch, prepared, level):
    scene, dry = prepared
    requests = []
    found = PlanarMotion.still(scene.bodies["bell"].pose, dry.meeting)
    monkeypatch.setattr(
        module, "back_calculate_motion", lambda asked, *of: requests.append(asked) or found
    )
    back_calculate(scene, dry, Setup())
    asked, alpha = requests[0], requests[0].alpha
    limits = MotionRequest(
        level, alpha, 6.0, asked.end_pose, asked.workspace, end_speed_limit=asked.end_speed_limit
    )
    paths = DRAW[level](np.random.default_rng(1), 20_000, limits)
    reasons = judge_shapes(paths, limits)
    last = np.arange(len(reasons)), (paths.durations > 0).sum(-1) - 1
    slopes = (paths.coefficients[last] * np.arange(paths.coefficients.shape[-1])).sum(-1)
    speeds = np.linalg.norm(slopes, axis=-1) / paths.durations[last] / alpha
    assert 2.5 < speeds[reasons == ""].max() <= 3
    assert asked.tail == 0.25
    assert 3 < speeds[reasons == "end_speed"].min() < 3.5


def test_jumps_are_capped_as_the_page_says_above_alpha_0_1_or_where_a_recipe_asks(prepared):
    page = (Path(__file__).parents[2] / "docs/motions.md").read_text()
    stated = re.search(r"bounds the jumps of a level-3 target's velocity by (\d+) alpha", page)
    assert stated
    for alpha, setup, factor in (
        (0.1, {}, None),
        (0.1, {"jumps": "capped"}, 1),
        (0.3, {}, 1),
        (0.3, {"rules": "domino"}, None),
    ):
        _, limit = module.strictness(Setup(**setup), alpha)
        assert limit == (None if factor is None else pytest.approx(factor * int(stated[1]) * alpha))


def test_a_point_counts_as_seen_4_pixels_inside_the_image(prepared):
    scene, _ = prepared
    head = cameras_of(scene.embodiment, "D435")[0]
    points = np.stack(
        np.meshgrid(np.linspace(-0.6, 0.6, 400), [0.0], [TABLE_TOP], indexing="ij"), -1
    ).reshape(-1, 3)
    columns = project(head.type, head.pose, points)[0][:, 0]
    seen = columns[scene.sees(points)]
    assert 4 <= seen.min() < 6 and head.type.width - 6 < seen.max() <= head.type.width - 4


# --- clearance
# ------------------------------------------------------------------------------------------


def robot_boxes(scene, dry, steps):
    """Axis-aligned bounds (S,P,3) twice of every collision piece of both arms at steps of the
    sweep."""
    low, high = [], []
    for index, name in enumerate(dry.names):
        side = next((s for s in SIDES if name.startswith(s)), None)
        if side:
            link = next(x for x in scene.embodiment.arms[side].links if f"{side}_{x.name}" == name)
            for piece in link.collision:
                points = transform(dry.sweep[steps, index][:, None], piece.support_points()[None])
                low.append(points.min(1))
                high.append(points.max(1))
    return np.stack(low, 1), np.stack(high, 1)


def gap(boxes, scene, motion, times):
    """Smallest gap (m) between boxes around the bell and around the robot's pieces: a lower bound
    of the true distance."""
    corners = np.concatenate(
        [c.support_points() for c in scene.bodies["bell"].instance.shape().collision]
    )
    points = transform(motion.pose(times)[:, None], corners[None])
    low, high = points.min(1)[:, None], points.max(1)[:, None]
    return float(np.maximum(low - boxes[1], boxes[0] - high).max(-1).min())


def fingers_at(scene, dry, t):
    """World position of the tcp of the acting arm at a time of the dry run."""
    side = scene.arms["arm"]
    arm = scene.embodiment.arms[side]
    return compose(dry.sweep[round(t * 60), dry.names.index(f"{side}_{arm.hand}")], arm.tcp)[:3]


def test_the_dry_runs_own_target_is_free(prepared):
    scene, dry = prepared
    assert Clearance(scene, dry).free(PlanarMotion.still(scene.bodies["bell"].pose, dry.meeting))


def test_a_motion_through_the_hand_is_refused(prepared):
    scene, dry = prepared
    # at the height of the fingers half a second before the meeting, at their place then
    t = dry.meeting - 0.5
    end, hand = scene.bodies["bell"].pose, fingers_at(scene, dry, t)
    offset = (hand[:2] - end[:2]) * dry.meeting / (dry.meeting - t)
    c = np.array([[end[i] + offset[i], -offset[i]] for i in range(2)])
    raised = PlanarMotion(
        1, 1.0, dry.meeting, 0.0, float(hand[2]) - 0.03, end[3:], (Segment(0.0, dry.meeting, c),)
    )
    np.testing.assert_allclose(raised.position(t)[:2], hand[:2], atol=1e-9)
    assert not Clearance(scene, dry).free(raised)


def test_standing_in_the_way_later_than_just_before_the_meeting_is_allowed(prepared):
    scene, dry = prepared
    clearance = Clearance(scene, dry)
    touching = replace(dry, meeting=dry.meeting + 2 * EARLY)
    # the same still target is blocked once the sweep is read to the very touch
    still = PlanarMotion.still(scene.bodies["bell"].pose, dry.meeting)
    assert clearance.free(still)
    pressed = np.repeat(dry.sweep[-1:], 60, 0)
    assert not Clearance(scene, replace(touching, sweep=np.concatenate([dry.sweep, pressed]))).free(
        still
    )


class Seen:
    """A target that stands at `pose` until `until` s and is out of reach from then on."""

    def __init__(self, pose, until=np.inf):
        self._pose, self._until = pose, until

    def pose(self, t):
        away = lifted(self._pose, 3.0)
        return np.where((np.asarray(t) < self._until)[..., None], self._pose, away)

    def scenery(self):
        return ()


def test_a_target_that_is_touched_too_soon_is_refused(prepared):
    """The fingertips creep the last 0.6 mm and come down at 0.1 m/s before: a bell 2 mm higher is
    touched 0.2 s too soon."""
    scene, dry = prepared
    pose = scene.bodies["bell"].pose
    assert Clearance(scene, dry).free(Seen(pose))
    assert not Clearance(scene, dry).free(Seen(lifted(pose, 0.002)))


def test_nothing_comes_within_2_mm_of_a_target_before_the_last_approach(prepared):
    """The highest place at which the bell is free there is one where it would be touched by pieces
    2 mm larger, and no nearer."""
    scene, dry = prepared
    pose, shape = scene.bodies["bell"].pose, scene.bodies["bell"].instance.shape().collision
    steps = int((dry.meeting - CLOSING) * 60)
    heights = np.arange(0.0, 0.1, 0.0005)
    free = [
        Clearance(scene, dry).free(Seen(lifted(pose, height), (steps - 0.5) / 60))
        for height in heights
    ]
    assert free[0] and not free[-1]
    lowest = lifted(pose, heights[free.index(False)])
    links = {
        f"{side}_{link.name}": link.collision
        for side, arm in scene.embodiment.arms.items()
        for link in arm.links
    }
    pieces = [(dry.names.index(name), piece) for name, shapes in links.items() for piece in shapes]
    sweeps = [Sweep(pieces, dry.sweep[:steps], shape, margin) for margin in (0.0012, 0.0022)]
    assert [sweep.first_contact(np.repeat(lowest[None], steps, 0)) is None for sweep in sweeps] == [
        True,
        False,
    ]


def test_clearance_agrees_with_brute_force_where_boxes_are_far_apart(prepared):
    scene, dry = prepared
    # until fingertips creep down onto the target: boxes around it touch theirs from then on
    clearance = Clearance(scene, replace(dry, meeting=dry.meeting - CLOSING + EARLY))
    steps = np.arange(int((dry.meeting - CLOSING) * 60) + 1)
    boxes, far = robot_boxes(scene, dry, steps), 0
    for angle in np.arange(0, 2 * np.pi, np.pi / 8):
        for radius in (0.05, 0.3):
            motion = straight(scene, dry, radius * np.array([np.cos(angle), np.sin(angle)]))
            if gap(boxes, scene, motion, steps / 60) > 0.004:
                far += 1
                assert clearance.free(motion)
    assert far >= 8


def test_a_motion_through_another_body_is_refused():
    scene = build_scene(EpisodeSpec("place_container_plate", "aloha-agilex", 1, 0.1, "clean", 0, 0))
    names = ("plate", "container", "table")
    sweep = np.stack(
        [
            [
                scene.bodies["plate"].pose,
                scene.bodies["container"].pose,
                np.array([0, 0, 0.74, 1, 0, 0, 0]),
            ]
        ]
        * 241
    )
    dry = DryRun(np.zeros((0, 14)), np.zeros((0, 14)), 4.0, {}, sweep, names, 0, None)
    plate, container = scene.bodies["plate"].pose, scene.bodies["container"].pose

    def towards(distance):
        away = (container[:2] - plate[:2]) / np.linalg.norm(container[:2] - plate[:2]) * distance
        c = np.array([[plate[i] + away[i], -away[i]] for i in range(2)])
        return PlanarMotion(1, 0.5, 4.0, 0.0, float(plate[2]), plate[3:], (Segment(0.0, 4.0, c),))

    clearance = Clearance(scene, dry)
    assert clearance.free(towards(0.0))
    assert not clearance.free(towards(float(np.linalg.norm(container[:2] - plate[:2]))))
    assert clearance.free(towards(-0.1))


# --- back-calculation
# ------------------------------------------------------------------------------------------


def test_the_motion_keeps_time_place_speed_and_view(prepared):
    scene, dry = prepared
    head = cameras_of(scene.embodiment, "D435")[0]
    for level, lead in ((1, 0.0), (2, 0.5), (3, 0.0)):
        moved = replace(scene, spec=replace(scene.spec, level=level))
        motion = back_calculate(moved, dry, Setup(lead=lead))
        np.testing.assert_allclose(motion.pose(dry.meeting), scene.bodies["bell"].pose, atol=1e-9)
        assert (motion.lead, motion.duration, motion.level) == (lead, dry.meeting, level)
        assert 0 < motion.average_speed() <= 0.1 * (1 + 1e-9)
        t = np.linspace(-lead, dry.meeting, 300)
        assert visible(head.type, head.pose, motion.position(t)).all()
        assert scene.task.workspace.contains(motion.position(t)).all()
        assert Clearance(scene, dry).free(motion)
        again = back_calculate(moved, dry, Setup(lead=lead))
        assert again.to_json() == motion.to_json()
    fast = back_calculate(scene, dry, Setup(speed_bound="maximum"))
    assert fast.maximum_speed() <= 0.1 * (1 + 1e-9)


def test_an_impossible_motion_is_a_failure_with_its_reason(prepared, monkeypatch):
    scene, dry = prepared
    monkeypatch.setattr(type(scene.task), "workspace", Workspace(-0.35, 0.35, 0.3, 0.4))
    with pytest.raises(Failure, match="end_outside") as failure:
        back_calculate(scene, dry, Setup())
    assert (failure.value.stage, failure.value.reason) == ("back_calculate", "no_motion")


# --- replay
# ------------------------------------------------------------------------------------------


def test_a_target_that_is_elsewhere_is_missed(prepared):
    scene, dry = prepared
    end = scene.bodies["bell"].pose
    away = end + np.array([-0.25 * np.sign(end[0]), 0.1, 0, 0, 0, 0, 0])
    with pytest.raises(Failure) as failure:
        replay(scene, dry, PlanarMotion.still(away, dry.meeting), 15)
    assert (failure.value.stage, failure.value.reason) == ("replay", "missed")


def test_a_task_that_fails_at_its_end_is_no_success(prepared, monkeypatch):
    scene, dry = prepared
    late = {"early": True, "short": False, "rung_once": False}
    monkeypatch.setattr(
        type(scene.task), "success", lambda self, o, arms: late | {"short": len(o.log) < 10}
    )
    with pytest.raises(Failure) as failure:
        replay(scene, dry, PlanarMotion.still(scene.bodies["bell"].pose, dry.meeting), 15)
    assert (failure.value.stage, failure.value.reason) == ("replay", "no_success")
    assert failure.value.conditions == ("short", "rung_once")
    with pytest.raises(
        Failure, match=r"no_success \(does not hold at the end: short, rung_once\)"
    ) as failure:
        dry_run(scene, 15)
    assert (failure.value.stage, failure.value.reason) == ("dry_run", "no_success")
    assert failure.value.conditions == ("short", "rung_once")


def test_a_script_that_never_reaches_its_target_has_no_meeting(prepared, monkeypatch):
    scene, _ = prepared
    monkeypatch.setattr(type(scene.task), "meet", lambda self, a: iter(()))
    with pytest.raises(Failure) as failure:
        dry_run(scene, 15)
    assert (failure.value.stage, failure.value.reason) == ("dry_run", "no_meeting")


def test_too_few_steps_is_a_reason(prepared, monkeypatch):
    scene, dry = prepared
    monkeypatch.setattr(type(scene.task), "step_limit", 5)
    for run in (
        lambda: dry_run(scene, 15),
        lambda: replay(scene, dry, PlanarMotion.still(scene.bodies["bell"].pose, 1.0), 15),
    ):
        with pytest.raises(Failure) as failure:
            run()
        assert failure.value.reason == "step_limit"


def test_an_accepted_replay_repeats_and_its_plan_is_the_dry_runs(prepared):
    scene, dry = prepared
    motion = back_calculate(scene, dry, Setup())
    first, second = replay(scene, dry, motion, 15), replay(scene, dry, motion, 15)
    assert first.log.poses.tobytes() == second.log.poses.tobytes()
    assert first.log.contacts.tobytes() == second.log.contacts.tobytes()
    assert first.log.events == second.log.events
    assert (first.log.skills, first.log.touches) == (second.log.skills, second.log.touches)
    frames = len(dry.commands) // 16
    np.testing.assert_array_equal(first.log.action[:frames], dry.commands[15::16][:frames])
    assert first.steps >= len(dry.commands)


# --- success
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("holds", "since"),
    [
        ("1111", 0.0),
        ("0011", 2 / 15),
        ("1011", 2 / 15),
        ("0001", 3 / 15),
        ("1110", None),
        ("0000", None),
    ],
)
def test_success_counts_from_where_it_holds_to_the_end(prepared, monkeypatch, holds, since):
    scene, _ = prepared
    log = four_frames(scene)
    monkeypatch.setattr(
        type(scene.task),
        "success",
        lambda self, o, arms: {"always": True, "sometimes": holds[len(o.log) - 1] == "1"},
    )
    assert success_time(scene, log) == (pytest.approx(since) if since is not None else None)


def four_frames(scene):
    body = scene.bodies["bell"]
    s = Simulation(scene.embodiment, (body,), "bell", PlanarMotion.still(body.pose, 1.0))
    recorder = Recorder(s, 15)
    for _ in range(48):
        s.step(s.home_vector(), np.zeros(len(s.command)))
        recorder.after_step()
    return recorder.log()


def test_the_runs_of_skills_are_those_of_the_replay(prepared):
    scene, dry = prepared
    log = replay(scene, dry, back_calculate(scene, dry, Setup()), 15).log
    closing, pressing, lifting, homing = log.skills
    arm = scene.arms["arm"]
    assert [(run.skill, run.body, run.part, run.half) for run in log.skills] == [
        *(
            ("close", "", "", "meet"),
            ("press", "bell", "button", "meet"),
            ("lift", "", "", "finish"),
            ("home", "", "", "finish"),
        )
    ]
    assert {run.arms for run in log.skills} == {(arm,)}
    # the arm first moves in the step after the jaws have closed, and the first half ends with the
    # press
    still = np.abs(np.delete(dry.commands - dry.commands[0], [6, 13], 1)).max(1) < 1e-12
    assert (closing.start, pressing.start) == (0, closing.end) and int(
        np.argmin(still)
    ) == closing.end
    assert dry.commands[closing.end - 1, [6, 13][SIDES.index(arm)]] == 0.0
    assert pressing.end == lifting.start == len(dry.commands) and lifting.end == homing.start
    # frames lie 16 steps apart: the commands rise by 6 cm from the last frame before the lift to
    # the first one after it
    first, last = lifting.start // 16, -(-lifting.end // 16)
    height = log.tcp[:, SIDES.index(arm), 2]
    assert height[last] - height[first] == pytest.approx(0.06, abs=0.01)


def test_a_first_touch_is_the_first_of_all_steps(prepared):
    scene, dry = prepared
    motion = back_calculate(scene, dry, Setup())
    (touch,) = replay(scene, dry, motion, 15).log.touches
    actor = scene.start(motion, 15, "replay")
    for command, velocity in zip(dry.commands, dry.velocities, strict=True):
        actor.advance(command, velocity)
        s = actor.simulation
        rows = [
            row
            for row in s.contacts()
            if s.names[row[0]] == "bell" and s.names[row[1]].startswith(("left_", "right_"))
        ]
        if rows:
            break
    assert (
        touch.step == s.steps == round(next(e.time for e in s.events if e.name == "meeting") * 240)
    )
    assert touch.side == scene.arms["arm"] and s.names[rows[0][1]].startswith(touch.side)
    np.testing.assert_array_equal(touch.tcp, s.tcp(touch.side))
    np.testing.assert_array_equal(touch.target, s.pose("bell"))
    points = sum(row[4] for row in rows)
    mean = sum(row[4] * row[3] for row in rows) / points
    assert touch.points == points
    np.testing.assert_allclose(touch.point, mean, atol=1e-12)
