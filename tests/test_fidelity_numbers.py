"""Numbers that docs/fidelity.md states of ours, read back from a running scene, from what is drawn,
or from the tasks' scripts.

`reads` hands a test the numbers of the second cell of a row, in SI units, so that page and code
cannot part. The last test finds rows with numbers that no test reads.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.episode.meta import CLUTTER
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scoring.clock import STEP_LOCKED_RATE
from pipeline.evaluate.scoring.metrics import manipulation_score
from pipeline.expert.budgets import GRASP, PLACE, SWING, TIMING
from pipeline.expert.skills.hand import jaws
from pipeline.motion.models.planar import ABRUPT
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import compose, inverse, lifted, quat_rotate, yawed
from pipeline.stages import surroundings
from pipeline.stages.back_calculate import END_SPEED
from pipeline.stages.drawing.render import visuals_of
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS
from pipeline.tasks.library.domino.handle.handover_mic import HELD_UP
from pipeline.tasks.library.domino.put_in.put_object_cabinet import HELD as CABINET_DROP
from pipeline.world.cameras import cameras_of, observer
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.objects import FAMILIES
from pipeline.world.physics import drive
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.simulation import PHYSICS_HZ, Simulation
from pipeline.world.robots import get_embodiment
from tests.expert.simulated import actor_among, body

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/fidelity.md").read_text()
ROBOTS = ("aloha-agilex", "arx-x5", "franka-panda", "piper", "ur5-wsg")
JAW_FORCE = {"aloha-agilex": 40, "arx-x5": 40, "franka-panda": 70, "piper": 40, "ur5-wsg": 80}
DT = 1 / PHYSICS_HZ
G = 9.81

UNITS = {"cm": 0.01, "mm": 0.001, "degrees": np.pi / 180, "degree": np.pi / 180, "%": 0.01}
NUMBER = re.compile(
    r"(-?\d+(?:,\d{3})*(?:\.\d+)?)(?:/(\d+))?(?:(?: to| and| or|,) (\d+(?:\.\d+)?))?"
    r" ?(cm|mm|degrees?|%)?"
)


def numbers(text: str) -> list[float]:
    """The numbers of a text in its order; "3 to 8 cm" are two."""
    values = []
    for first, below, second, unit in NUMBER.findall(re.sub(r"\([^()]*\.md[^()]*\)", "", text)):
        value = float(first.replace(",", "")) / float(below or 1)
        values += [float(each) * UNITS.get(unit, 1.0) for each in (value, second) if each != ""]
    return values


def rows() -> Iterator[tuple[str, str]]:
    """First and second cell of the rows of all tables whose second column is ours."""
    is_ours = False
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if not cells:
            is_ours = False
        elif cells[1] == "ours":
            is_ours = True
        elif is_ours and not cells[0].startswith("---"):
            yield cells[0], cells[1]


ROWS = list(rows())
READ = set[tuple[str, str]]()


def reads(row: str, text: str = "") -> Any:
    """Hand a test the numbers of the row whose first cell begins with `row` and whose second one
    contains `text`."""
    found = [cells for cells in ROWS if cells[0].startswith(row) and text in cells[1]]
    assert len(found) == 1, (row, text, found)
    READ.add(found[0])
    return pytest.mark.parametrize("stated", [numbers(found[0][1])], ids=[f"{row} {text}".strip()])


# --- the running scene
# ------------------------------------------------------------------------------------------


def scene_of(robot: str, *bodies: Body, motion: PlanarMotion | None = None) -> Simulation:
    """A scene of a robot and bodies; the first one is the target, by default a can out of the
    way."""
    bodies = bodies or (body("target", "can", -0.5, 0.3),)
    return Simulation(
        get_embodiment(robot), bodies, "target", motion or PlanarMotion.still(bodies[0].pose, 1.0)
    )


def run(scene: Simulation, steps: int, command: np.ndarray | None = None) -> None:
    held = scene.home_vector() if command is None else command
    for _ in range(steps):
        scene.step(held, np.zeros(len(held)))


def surfaces(components: Any) -> set[tuple[float, ...]]:
    """Static friction, dynamic friction and restitution of all collision shapes."""
    found = [shape.physical_material for each in components for shape in each.collision_shapes]
    return {
        tuple(round(float(v), 6) for v in (m.static_friction, m.dynamic_friction, m.restitution))
        for m in found
    }


@pytest.fixture(scope="module", params=ROBOTS)
def scene(request: pytest.FixtureRequest) -> Simulation:
    """A scene of each robot."""
    return scene_of(request.param)


def sliding(family: str, speed: float) -> tuple[float, float]:
    """The slowing down (m/s2) of a body let go at `speed` on the table, and the friction of its
    shape."""
    instance = FAMILIES[family].draw(np.random.default_rng(0))
    start = Body("target", family, instance, yawed((0.0, 0.1, TABLE_TOP), 0.0))
    line = Segment(0.0, 2.0, np.array([[0.0, 2.0 * speed], [0.1, 0.0]]))
    scene = scene_of(
        "piper", start, motion=PlanarMotion(1, speed, 2.0, 0.0, TABLE_TOP, start.pose[3:], (line,))
    )
    run(scene, 8)
    scene.release()
    run(scene, 4)
    before = scene._moved.linear_velocity[0]
    run(scene, 16)
    return (before - scene._moved.linear_velocity[0]) / (16 * DT), instance.shape().friction


@reads("time step")
def test_a_body_falls_by_one_time_step(stated):
    block = body("target", "block", 0.3, 0.2)
    scene = scene_of("piper", replace(block, pose=lifted(block.pose, 0.5)))
    scene.release()
    heights = []
    for _ in range(40):
        run(scene, 1)
        heights.append(scene.pose("target")[2])
    assert np.sqrt(-np.diff(heights, 2) / G).mean() == pytest.approx(stated[0], rel=1e-3)


@reads("friction of the robot's links")
def test_every_link_has_its_friction_and_no_restitution(stated, scene):
    links = [link for arm in scene._arms.values() for link in arm.robot.links]
    assert surfaces(links) == {(stated[0], stated[0], 0.0)}


@reads("friction of the table")
@pytest.mark.parametrize(("family", "speed"), [("soap", 0.6), ("bread_basket", 0.6)])
def test_two_surfaces_rub_with_the_mean_of_their_frictions(stated, family, speed):
    slowed, own = sliding(family, speed)
    assert own != stated[0]
    assert slowed == pytest.approx(G * (stated[0] + own) / 2, rel=0.01)


@reads("distance from a shape within which contacts")
def test_contacts_are_looked_for_as_near_as_stated(stated):
    """Those of all shapes but the floor."""
    scene = scene_of(
        "aloha-agilex", body("target", "can", -0.5, 0.3), body("block", "block", 0.3, 0.2)
    )
    offsets = {
        round(shape.contact_offset, 9)
        for entity in scene._scene.entities
        if entity.name != "floor"
        for component in entity.components
        for shape in getattr(component, "collision_shapes", ())
    }
    assert offsets == set(stated)


@reads("friction of bodies")
def test_bodies_have_the_friction_of_their_shapes_and_do_not_bounce(stated):
    drawn = {name: family.draw(np.random.default_rng(0)) for name, family in FAMILIES.items()}
    frictions = {name: instance.shape().friction for name, instance in drawn.items()}
    assert [min(frictions.values()), max(frictions.values())] == stated
    names = [
        next(name for name, friction in frictions.items() if friction == value)
        for value in sorted({*frictions.values()})
    ]
    bodies = [
        Body(name, name, drawn[name], yawed((0.3 * i - 1, 0.8, 2.0), 0))
        for i, name in enumerate(names)
    ]
    scene = scene_of("piper", body("target", "can", -0.5, 0.3), *bodies)
    for name in names:
        assert surfaces([scene._rigid[name]]) == {(frictions[name], frictions[name], 0.0)}


def test_what_is_dropped_does_not_bounce():
    block = body("target", "block", 0.3, 0.2)
    scene = scene_of("piper", replace(block, pose=lifted(block.pose, 0.3)))
    scene.release()
    run(scene, round(np.sqrt(2 * 0.3 / G) / DT) + 6)  # it lands with 2.4 m/s
    heights = []
    for _ in range(60):
        run(scene, 1)
        heights.append(scene.pose("target")[2] - block.pose[2])
    assert max(heights) < 0.002


@reads("drives of the arms")
def test_arms_are_driven_as_stated_up_to_the_torque_limits_of_the_joints(stated, scene):
    for side, built in scene._arms.items():
        efforts = {joint.name: joint.effort for joint in scene.embodiment.arms[side].joints}
        found = [(joint.stiffness, joint.damping, joint.force_limit) for joint in built.joints]
        wanted = [(*stated, efforts[joint.name]) for joint in built.joints]
        np.testing.assert_allclose(found, wanted, rtol=1e-6)


@reads("drives of the jaws")
def test_jaws_are_driven_as_stated_up_to_the_force_of_the_gripper(stated, scene):
    for built in scene._arms.values():
        found = [(joint.stiffness, joint.damping, joint.force_limit) for joint in built.jaws]
        np.testing.assert_allclose(
            found, [(*stated, JAW_FORCE[scene.embodiment.name])] * 2, rtol=1e-6
        )


def test_links_weigh_what_the_vendors_descriptions_say(scene):
    for side, built in scene._arms.items():
        masses = {link.name: link.mass for link in scene.embodiment.arms[side].links}
        wanted = [masses[link.name] for link in built.robot.links]
        np.testing.assert_allclose([link.mass for link in built.robot.links], wanted, rtol=1e-5)
        assert sum(wanted) > 3


@reads("damping of a target")
def test_what_flies_is_damped_as_stated(stated):
    can = body("target", "can", 0.3, 0.2)
    scene = scene_of("piper", replace(can, pose=lifted(can.pose, 1.0)))
    scene.release()
    scene._moved.set_linear_velocity([0.5, 0, 0])
    scene._moved.set_angular_velocity([0, 0, 3])  # about an axis of symmetry
    run(scene, 90)
    np.testing.assert_allclose(
        scene.target_twist()[[0, 5]], [0.5, 3 * np.exp(-stated[0] * 90 * DT)], rtol=1e-4
    )


@reads("jaws")
def test_jaws_wait_after_they_have_closed(stated):
    actor = actor_among(body("target", "can", -0.3, 0.2))
    values = jaws(actor, "right", 0.0)["right"].gripper
    assert (values == values[-1]).sum() * DT == pytest.approx(stated[0], abs=1.5 * DT)
    gripper = actor.simulation.embodiment.arms["right"].gripper
    assert np.abs(np.diff(values)).max() * gripper.opened[0] / DT == pytest.approx(
        gripper.speed, rel=1e-3
    )


# --- what is drawn
# ------------------------------------------------------------------------------------------


def randomized(seed: int) -> EpisodeSpec:
    return EpisodeSpec("click_bell", "piper", 1, 0.1, "randomized", 0, seed)


@reads("height of the table")
def test_the_table_is_lower_by_any_share_of_its_most(stated):
    drops = np.array([surroundings.table_drop(randomized(seed)) for seed in range(400)])
    assert 0 <= drops.min() < 0.02 * stated[0]
    assert 0.98 * stated[0] < drops.max() <= stated[0]
    assert drops.mean() == pytest.approx(stated[0] / 2, rel=0.1)


@reads("head camera, randomized")
def test_the_head_camera_is_moved_and_turned_by_any_share_of_the_most(stated):
    home = get_embodiment("piper").head_camera
    specs = [randomized(seed) for seed in range(100)]
    lowered = [
        surroundings.embodiment_of(each, "ours", surroundings.stance_of(each)).head_camera
        - np.eye(7)[2] * surroundings.table_drop(each)
        for each in specs
    ]
    moved = np.array([compose(inverse(home), each) for each in lowered])
    angles = 2 * np.arcsin(np.linalg.norm(moved[:, 4:], axis=1))
    assert 0.9 * stated[0] < np.abs(moved[:, :3]).max() <= stated[0] + 1e-9
    assert 0.9 * stated[1] < angles.max() <= np.sqrt(3) * stated[1] * 1.01


@reads("room that distractors leave")
def test_distractors_keep_the_room_that_is_measured_elsewhere(stated):
    """tests/stages/test_surroundings.py measures it in scenes."""
    assert stated == [surroundings.TASK_GAP, surroundings.CLUTTER_GAP]


@reads("distractors, randomized domain")
def test_distractors_are_as_many_and_as_low_as_stated(stated):
    assert [*CLUTTER, len(surroundings.CLUTTER_FAMILIES), surroundings.LOW] == stated


@reads("surfaces, randomized domain")
def test_few_surfaces_are_plain(stated):
    drawn = [visuals_of(randomized(seed), Setup()) for seed in range(1500)]
    plain = sum(
        (v.table == CLEAN.table) + (v.wall == CLEAN.wall) + (v.ground == CLEAN.ground)
        for v in drawn
    )
    expected = stated[0] * 3 * len(drawn)
    assert abs(plain - expected) < 4 * np.sqrt(expected)


@reads("head camera", "(-0.032")
@pytest.mark.parametrize("name", ROBOTS)
def test_the_head_camera_stands_where_it_is_said_to(stated, name):
    head, *_ = cameras_of(get_embodiment(name))
    np.testing.assert_allclose(head.pose[:3], stated[:3], atol=1e-9)
    assert [np.radians(head.type.fovy), head.type.width, head.type.height] == pytest.approx(
        stated[3:]
    )


@reads("wrist cameras")
@pytest.mark.parametrize("name", ROBOTS)
def test_wrist_cameras_are_beside_the_axis_of_the_hand(stated, name):
    robot = get_embodiment(name)
    for camera in cameras_of(robot)[1:]:
        arm = robot.arms[camera.name.split("_")[0]]
        beside = compose(inverse(arm.tcp), camera.pose)[1:3]
        assert (
            stated[0] <= np.linalg.norm(beside) + 1e-9
            and np.linalg.norm(beside) - 1e-9 <= stated[1]
        )
        assert [
            np.radians(camera.type.fovy),
            camera.type.width,
            camera.type.height,
        ] == pytest.approx(stated[2:])


@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "aloha-agilex"])
def test_the_robots_stand_where_they_are_said_to(name):
    cells = next(cells for cells in ROWS if cells[0] == name)
    arms = get_embodiment(name).arms
    for side, sign in (("left", -1), ("right", 1)):
        np.testing.assert_allclose(arms[side].base[:3] * [sign, 1, 1], numbers(cells[1]), atol=1e-9)
    READ.add(cells)


@reads("observer")
def test_the_observer_stands_across_the_table(stated):
    camera = observer(CAMERA_TYPES["D435"])
    assert [*camera.pose[:3], np.radians(camera.type.fovy)] == pytest.approx(stated)


# --- clock, scores, contact, law
# ------------------------------------------------------------------------------------------


@reads("motion of the target per step")
def test_step_locked_targets_move_as_far_a_step_as_stated(stated):
    assert stated == pytest.approx([STEP_LOCKED_RATE / 15, STEP_LOCKED_RATE, 1 / 15], rel=3e-3)


@reads("400 steps of simulated time")
def test_a_step_is_one_recorded_frame(stated):
    assert stated[0] == pytest.approx(400 / 15, rel=2e-3)


@reads("clutter in MS")
def test_touched_clutter_costs_a_share_of_the_score(stated):
    assert manipulation_score(100.0, out_of_bounds=False, clutter=True) == pytest.approx(
        100 * stated[0]
    )


@reads("out of bounds in MS")
def test_a_target_out_of_bounds_halves_the_score(stated):
    assert manipulation_score(100.0, out_of_bounds=True, clutter=False) == pytest.approx(
        100 * stated[0]
    )


def test_the_drive_of_a_held_target_is_the_one_of_the_text():
    """tests/world/physics/test_drive.py measures it in scenes."""
    text = " ".join(PAGE.split("Under `hold`")[1].split("## ")[0].split())
    found = re.search(
        r"\((\d+) rad/s\).*at most (\d+) N and ([\d.]+) N m.* about ([\d.]+) m/s.* held for"
        r" ([\d.]+) s",
        text,
    )
    assert found
    returning = drive.RATE * drive.REACH / 2
    assert [float(each) for each in found.groups()] == [
        drive.RATE,
        drive.FORCE,
        drive.TORQUE,
        returning,
        drive.HELD,
    ]


def test_filters_of_shapes_are_those_of_the_table():
    """tests/motion/test_back_calculate.py measures them on drawn motions."""
    law = PAGE.split("## Law of the speeds")[1]
    assert f"no jump of {ABRUPT:g} alpha" in law
    assert f"the end speed is above {END_SPEED:g} alpha" in law


# --- the experts' scripts
# ------------------------------------------------------------------------------------------


def arguments() -> dict[tuple[str, str], dict[str, list[float]]]:
    """Numbers that the tasks' scripts pass to skills: (skill, argument) -> by module, constants of
    modules and classes resolved."""
    found: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted((ROOT / "pipeline/tasks/library/domino").rglob("*.py")):
        tree = ast.parse(path.read_text())
        constants = dict[str, float]()
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(
                node.value, ast.Constant
            ):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = [
                    name.id
                    for each in targets
                    for name in ast.walk(each)
                    if isinstance(name, ast.Name)
                ]
                constants |= dict.fromkeys(names, node.value.value)
                for name in names:
                    if isinstance(node.value.value, float) and name in ("up", "above"):
                        found["class", name][path.stem].append(node.value.value)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                given = [(f"{i}", value) for i, value in enumerate(node.args)] + [
                    (k.arg or "", k.value) for k in node.keywords
                ]
                for name, value in given:
                    number = (
                        constants.get(value.id)
                        if isinstance(value, ast.Name)
                        else getattr(value, "value", None)
                    )
                    if isinstance(number, float):
                        found[node.func.id, name][path.stem].append(number)
    return {key: dict(values) for key, values in found.items()}


ARGUMENTS = arguments()


def given(*keys: tuple[str, str]) -> list[float]:
    return [value for key in keys for values in ARGUMENTS.get(key, {}).values() for value in values]


@reads("all", "a hand comes in")
def test_a_hand_comes_in_on_a_line_with_jaws_opened_as_stated(stated):
    standoffs = [*given(("grasp", "standoff")), GRASP.standoff]
    assert [min(standoffs) * GRASP.short_share, max(standoffs)] == pytest.approx(
        [min(stated[0], 0.03), stated[1]]
    )
    assert list(GRASP.openings) == stated[2:]


@reads("all", "set down straight")
def test_bodies_are_set_down_from_the_stated_height_and_pressed_on(stated):
    most, pressed, hammer, drop = stated
    heights = given(
        ("place", "above"),
        ("place_or_regrasp", "above"),
        ("set_down_on", "above"),
        ("class", "above"),
    )
    assert max([*heights, PLACE.above]) == pytest.approx(most)
    assert PLACE.press == pytest.approx(pressed)
    presses = {
        task: values
        for task, values in ARGUMENTS["place", "press"].items()
        if max(map(abs, values))
    }
    assert presses == {"beat_block_hammer": [hammer]}
    assert pytest.approx(drop) == CABINET_DROP


@reads("hanging_mug, put_object_cabinet")
def test_jaws_open_a_little_where_there_is_no_room(stated):
    openings = given(("open_", "by"), ("place", "opening"), ("place_or_regrasp", "opening"))
    assert stated[0] <= min(openings) and max(openings) <= stated[1]


@reads("all", "a lift goes straight up")
def test_lifts_are_as_high_as_stated(stated):
    heights = given(("lift", "1"), ("set_down_on", "up"), ("class", "up"))
    assert [min(heights), max(heights)] == pytest.approx(stated)


def stub(task: str, **more: Any) -> Any:
    """What a script asks of an actor before anything moved, in the first layout of a task."""
    scene = build_scene(EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 0, 0))
    return SimpleNamespace(
        arms=scene.arms,
        bodies=scene.bodies,
        pose=lambda name: scene.bodies[name].pose.copy(),
        frames=lambda name: scene.bodies[name].instance.frames(),
        **more,
    )


@reads("adjust_bottle")
def test_a_bottle_is_held_up_where_it_is_said_to_be(stated):
    near, far, low_y, high_y, lowest, highest = stated
    a = stub("adjust_bottle")
    cap = a.frames("bottle")["cap"]
    caps = compose(TASKS["adjust_bottle"]._raised(a), cap[None])
    assert {round(abs(x), 4) for x in caps[:, 0]} == {near, far}
    assert {round(y, 4) for y in caps[:, 1]} == {round(low_y * 0.01, 4), high_y}
    feet = caps[:, 2] - 2 * cap[0] - TABLE_TOP
    assert [feet.min(), feet.max()] == pytest.approx([lowest, highest])


@reads("place_bread_skillet", "pose in which the skillet is held")
def test_a_skillet_is_held_where_it_is_said_to_be(stated):
    held = TASKS["place_bread_skillet"]._held("left")
    heights = {round(z, 4) for z in held[:, 2] - TABLE_TOP}
    assert [min(heights), max(heights)] == stated[:2]
    assert np.abs(held[:, 0]).max() == pytest.approx(stated[2])
    np.testing.assert_allclose(quat_rotate(held[:, 3:], [0, 0, 1.0])[:, 2], 1)


@reads("place_can_basket, place_object_basket")
def test_a_basket_is_lifted_straight_up(stated):
    """By the script that both tasks share, after the target was lifted higher."""
    assert min(ARGUMENTS["lift", "1"]["basket"]) == stated[0]


@reads("place_phone_stand")
def test_a_phone_is_lifted_first(stated):
    """By the default of set_down_on, which its script does not change."""
    assert "place_phone_stand" not in ARGUMENTS.get(("set_down_on", "up"), {})
    assert given(("class", "up")).count(stated[0]) >= 1


@reads("shake_bottle, shake_bottle_horizontally")
def test_bottles_are_swung_as_far_as_stated(stated):
    assert [min(SWING.shake_angles), max(SWING.shake_angles)] == stated[:2]
    text = (ROOT / "pipeline/tasks/library/domino/handle/shake_bottle.py").read_text()
    assert stated[2:] == [0.38, 0.85] and "angles=(0.85, 0.7, 0.6, 0.5, 0.42, 0.38)" in text
    assert text.count("times=6") == 2


@reads("click_alarmclock, click_bell, press_stapler")
def test_fingertips_rest_as_long_as_stated(stated):
    """tests/expert/test_pressing.py measures rest and force in scenes."""
    assert TIMING.press == stated[0]


@reads("handover_block", "the receiver rises")
def test_the_receiver_of_a_block_rises_as_stated(stated):
    assert min(ARGUMENTS["lift", "1"]["handover_block"]) == stated[0]


@reads("handover_mic")
def test_a_microphone_ends_at_the_stated_height(stated):
    assert pytest.approx(stated[0]) == HELD_UP


@reads("put_bottles_dustbin")
def test_a_bottle_is_upright_or_tilted_over_the_bin(stated):
    poses = TASKS["put_bottles_dustbin"]._over_the_bin(stub("put_bottles_dustbin"))
    tilts = {
        round(float(np.arccos(np.clip(up, -1, 1))), 3)
        for up in quat_rotate(poses[:, 3:], [0, 0, 1.0])[:, 2]
    }
    assert tilts == {0.0, stated[0]}


READ_ELSEWHERE = {
    "speed of the arms": "tests/stages/test_shaking.py, tests/expert/test_limits.py",
    "aloha-agilex": "tests/world/robots/test_forward.py",
    "levels whose motion is retimed": "tests/evaluate/scoring/test_clock.py",
}


def test_every_row_with_a_number_is_read():
    left = {cells for cells in ROWS if numbers(cells[1])} - READ
    assert {first for first, _ in left} <= READ_ELSEWHERE.keys()
