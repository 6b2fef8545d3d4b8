"""Events in running scenes: until one happens, a scene has the bytes that it has without it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.episode.events import EventSpec
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import CONTROL, EVENTFUL, EpisodeSpec
from pipeline.evaluate.scenes.trial import Eyes, Trial, instruction_now, instruction_of
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.wrapped import CARRIED, Company, Rider, led_by
from pipeline.poses import pose, quat_about
from pipeline.run.names import recipe_from
from pipeline.run.slot.make import sentences
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.render import appearance_of, capture
from pipeline.stages.scene import build_scene

AT = 0.4  # s
VISIBLE = ("occluder", "tunnel", "light", "freeze", "second")
CHANGING = ("stop", "reverse", "speed", "push")


def scene_with(events, arm=EVENTFUL, task="click_bell"):
    spec = EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 0, 3, arm=arm)
    specs = tuple(map(EventSpec.model_validate, events))
    scene = build_scene(spec, Rules(events=specs))
    end = scene.bodies[scene.task.target].pose
    way = 0.2 if end[0] > 0 else -0.2  # from the middle of the table
    piece = Segment(0.0, 2.0, np.array([[end[0] - way, way], [end[1], 0.0]]))
    motion = PlanarMotion(1, 0.1, 2.0, 0.0, float(end[2]), end[3:], (piece,))
    others = {n: PlanarMotion.still(scene.bodies[n].pose, 2.0) for n in scene.task.movers}
    motion = Company(motion, others) if others else motion
    return scene.furnished(motion), motion


def run(events, arm=EVENTFUL, steps=216, task="click_bell"):
    """A robot that closes its hands on nothing, in a scene with events."""
    scene, motion = scene_with(events, arm, task)
    trial = Trial(scene, motion)
    closed = trial.simulation.home_vector()
    closed[list(trial.simulation.grippers)] = 0.0
    while trial.simulation.steps < steps and not trial.ending:
        trial.advance(closed)
    return scene, trial


@pytest.fixture(scope="module")
def quiet():
    return run([f"stop@{AT}"], CONTROL)


def same_until(one, other, name, frames):
    a, b = getattr(one, name)[:frames], getattr(other, name)[:frames]
    return a.tobytes() == b.tobytes()


@pytest.mark.parametrize("kind", [*CHANGING, "slip", "goal", "swap"])
def test_the_state_is_the_same_until_the_event_and_not_after_it(kind):
    task = "place_a2b_left" if kind == "goal" else "click_bell"
    one, two = (run([f"{kind}@{AT}"], arm, task=task)[1].log() for arm in (EVENTFUL, CONTROL))
    frames = round(AT * 15) + 1
    for name in ("poses", "qpos", "qvel", "state", "tcp", "target_velocity"):
        assert same_until(one, two, name, frames), name
    assert one.poses.tobytes() != two.poses.tobytes()
    assert [(e.name, e.time, e.by) for e in one.events][:1] == [("event", AT, kind)]
    assert [(e.name, e.time) for e in two.events] == [("event_withheld", AT)]


@pytest.mark.parametrize("kind", VISIBLE)
def test_images_are_the_same_until_the_event_and_not_after_it(kind):
    setup, frames = Setup(cameras=("head",), size=(80, 60)), round(AT * 15)
    views, logs, more = [], [], {"amount": 1.5} if kind == "second" else {"lasts": 0.3}
    for arm in (EVENTFUL, CONTROL):
        scene, trial = run([{"kind": kind, "when": {"time": AT}, **more}], arm)
        logs.append(trial.log())
        seen = capture(appearance_of(scene, setup), logs[-1], setup, [frames, frames + 4])
        views.append(seen.views[0].rgb)
        if arm == EVENTFUL:  # what a policy sees now is what a build stores
            eyes = Eyes(scene, setup)
            now = eyes.look(trial.recorder).images["head_camera"]
            last = capture(appearance_of(scene, setup), logs[-1], setup, [len(logs[-1]) - 1])
            assert now.tobytes() == last.views[0].rgb[0].tobytes()
            eyes.close()
    assert logs[0].bodies == logs[1].bodies
    assert views[0][0].tobytes() == views[1][0].tobytes()
    assert views[0][1].tobytes() != views[1][1].tobytes()


def test_the_scene_does_not_depend_on_its_events(quiet):
    other = scene_with(["occluder@0.2", "push@0.3"])[0]
    for name, body in quiet[0].bodies.items():
        assert other.bodies[name].pose.tobytes() == body.pose.tobytes()


def test_events_happen_in_sequence_and_end():
    events = [
        {"kind": "stop", "when": {"time": 0.2}, "lasts": 0.2},
        {"kind": "speed", "when": {"after": 0.4}, "amount": 3.0},
    ]
    log = run(events)[1].log()
    speed = np.linalg.norm(log.target_velocity, axis=1)
    assert [(e.name, e.time, e.by) for e in log.events] == [
        ("event", 0.2, "stop"),
        ("event_end", 0.4, "stop"),
        ("event", pytest.approx(0.6), "speed"),
    ]
    assert speed[[2, 4, 7, 12]] == pytest.approx([0.1, 0.0, 0.1, 0.3], abs=1e-9)


def test_an_occluder_hides_the_target_from_the_reactive_expert():
    scene, trial = run([{"kind": "occluder", "when": {"time": AT}, "amount": 0.15}])
    script, simulation = trial.simulation.script, trial.simulation
    target = simulation.pose(scene.task.target)[:3]
    assert script is not None
    assert script.hides(target, simulation.time)
    assert not script.hides(target, AT)
    assert not script.hides(target + np.array([0.0, 0.0, 0.6]), simulation.time)


def test_a_hand_that_slips_opens_though_it_is_commanded_to_close():
    _, slipped = run([f"slip@{AT}"])
    log = slipped.log()
    jaw = list(log.vector_names).index("left_gripper")
    assert log.state[round((AT + 0.2) * 15), jaw] > log.state[round(AT * 15), jaw] + 0.1
    assert (log.action[1:, jaw] == 0).all()


def test_a_stop_in_phase_after_changes_nothing_before_the_target_is_touched(quiet):
    scene, motion = scene_with([{"kind": "stop", "when": "meeting"}])
    trial = Trial(replace(scene), motion)
    trial.hold(96)
    assert not trial.simulation.events


def test_an_instruction_asks_for_another_body_and_moves_nothing():
    scene, trial = run([f"instruction@{AT}"], task="pick_named")
    quiet = run([f"instruction@{AT}"], CONTROL, task="pick_named")[1].log()
    log, (event,) = trial.log(), scene.events
    frames = round(AT * 15) + 1
    assert log.poses.tobytes() == quiet.poses.tobytes()
    assert np.linalg.norm(log.target_velocity[frames - 1]) > 0.05
    assert not log.target_velocity[frames + 1 :].any()
    asked, roles = scene.by_role(log)
    assert (roles.pose("block")[frames:] == log.pose(event.body)[frames:]).all()
    assert (roles.pose("block")[:frames] == log.pose("block")[:frames]).all()
    assert asked.choices != scene.choices
    words = instruction_of(scene)
    assert asked.choices["choice"] in instruction_now(trial, "unseen", words)
    assert scene.choices["choice"] in words
    assert scene.by_role(quiet) == (scene, quiet)


def test_a_swapped_body_waits_below_the_floor_and_takes_the_place_of_the_target():
    scene, trial = run([f"swap@{AT}"])
    log, frames = trial.log(), round(AT * 15) + 1
    bell, other = log.pose("bell")[:, 2], log.pose("event_swap")[:, 2]
    assert (bell[:frames] > 0.7).all() and (bell[frames:] < 0).all()
    assert (other[:frames] < 0).all() and (other[frames:] > 0.7).all()
    path = scene.by_role(log)[1].pose("bell")[:, :3]
    np.testing.assert_allclose(np.abs(np.diff(path, axis=0)[:, 0]), 0.1 / 15, rtol=1e-3)
    assert trial.simulation.can_take("event_swap")


def test_an_exchange_does_not_happen_once_the_target_was_touched():
    scene, motion = scene_with([f"swap@{AT}"])
    trial = Trial(scene, motion)
    trial.simulation.touched_by = "left_link7"
    trial.hold(192)
    assert not trial.simulation.events and not trial.simulation.roles


def test_what_is_carried_along_goes_on_around_another_leader():
    end = scene_with(["stop"])[0].bodies["bell"].pose
    turning = Segment(0.0, 2.0, np.array([[end[0], 0.1], [end[1], 0.05]]))
    base = PlanarMotion(1, 0.1, 2.0, 0.0, float(end[2]), end[3:], (turning,))
    places = {"second": pose((0.1, 0, 0), quat_about((0, 0, 1), 0.4)), "third": pose((0, 0.1, 0))}
    motion = Company(base, {name: Rider(base, at) for name, at in places.items()})
    led, t = led_by("second", motion), np.linspace(0.0, 2.0, 5)
    np.testing.assert_allclose(led.pose(t), motion.others["second"].pose(t), atol=1e-12)
    np.testing.assert_allclose(led.others["second"].pose(t), base.pose(t), atol=1e-12)
    np.testing.assert_allclose(
        led.others["third"].pose(t), motion.others["third"].pose(t), atol=1e-12
    )
    assert all(other.model == CARRIED for other in led.others.values())


@pytest.mark.parametrize(
    ("task", "kind"), [("pick_named", "instruction"), ("shake_bottle", "swap")]
)
def test_the_planned_expert_takes_what_is_asked_for_now(task, kind):
    setup = recipe_from({"tasks": [task], "events": [f"{kind}@share=0.5"]}).setup
    spec = EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 0, 0, arm=EVENTFUL)
    rollout = attempt(spec, setup)
    log, scene = rollout.replay.log, rollout.scene
    body, target = scene.events[0].body, scene.task.target
    i, j = log.bodies.index(body), log.bodies.index(target)
    hands = [n for n, name in enumerate(log.bodies) if name.startswith(("left_", "right_"))]
    touched = {frozenset(pair) for pair in zip(log.contacts["a"], log.contacts["b"], strict=True)}
    assert any({i, hand} in touched for hand in hands)
    assert not any({j, hand} in touched for hand in hands)
    assert all(scene.conditions(log).values())
    assert not all(replace(scene, rules=Rules()).conditions(log).values())
    spoken = sentences(scene, log, 2)
    assert spoken["seen"] != spoken["seen_after"]
