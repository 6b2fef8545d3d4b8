"""The randomized domain around a task: what it draws and from where, clutter out of the way, table
height and head camera."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from pipeline.data.cameras import extrinsics_cv
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.meta import CLUTTER, Drawing, EpisodeMeta
from pipeline.data.episode.writer import write_episode
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.names import SIDES
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import rules_of
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.planar import PlanarMotion
from pipeline.poses import angle_between, compose, inverse, pose, transform, yawed
from pipeline.run.slot.make import episode_of
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.render import appearance_of, render, visuals_of
from pipeline.stages.drawing.tracks import require_view
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.stages.surroundings import (
    ARM_GAP,
    CAMERA_SHIFT,
    CAMERA_TURN,
    CLUTTER_FAMILIES,
    CLUTTER_GAP,
    HANDS,
    LOW,
    TABLE_DROP,
    TASK_GAP,
    clutter,
    occluded,
    table_drop,
)
from pipeline.tasks import middle
from pipeline.world.cameras import cameras_of
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP, Body
from pipeline.world.physics.simulation import Simulation
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import arm_poses
from pipeline.world.robots.pairs import raised

TASKS = (
    "click_bell",
    "place_container_plate",
    "beat_block_hammer",
    "shake_bottle",
    "grab_roller",
    "handover_block",
)

DRAWING = Drawing(preset="raster-fast", visuals=CLEAN)
KEYS = SlotKeys(Key({}), Key({}), Key({}))


def spec(task="click_bell", seed=0, domain="randomized", level=1):
    return EpisodeSpec(task, "aloha-agilex", level, 0.1, domain, 0, seed)


@pytest.fixture(scope="module")
def stages():
    return [build_scene(spec(task, seed)) for task in TASKS for seed in range(4)]


@pytest.fixture(scope="module")
def rollout():
    return attempt(spec(), Recipe())


def contents(scene):
    return {name: (body.instance, *body.pose) for name, body in scene.bodies.items()}


# --- what is drawn
# ------------------------------------------------------------------------------------------


def test_the_clean_domain_draws_nothing_for_its_surroundings(monkeypatch):
    drawn, rng = [], EpisodeSpec.rng
    monkeypatch.setattr(
        EpisodeSpec, "rng", lambda self, purpose: drawn.append(purpose) or rng(self, purpose)
    )
    done = attempt(spec(domain="clean"), Recipe())
    assert set(drawn) == {
        "objects",
        "placement",
        "planning/dry_run",
        "planning/replay",
        "target_motion",
    }
    assert done.scene.embodiment is get_embodiment("aloha")
    assert done.scene.clutter == ()
    assert table_drop(done.scene.spec) == 0.0


def test_paired_cells_differ_only_where_the_other_camera_would_not_see_the_target(stages):
    same = 0
    for scene in stages:
        clean = build_scene(replace(scene.spec, domain="clean"))
        own = {name: body for name, body in contents(scene).items() if name not in scene.clutter}
        target = clean.bodies[scene.task.target]
        equal = own == contents(clean)
        assert equal or not scene.sees(middle(target.pose, target.instance))
        same += equal
    assert same > 0.7 * len(stages)


def test_a_randomized_scene_follows_from_its_spec(stages):
    for scene in stages:
        again = build_scene(replace(scene.spec, level=3))
        assert contents(again) == contents(scene)
        np.testing.assert_array_equal(again.embodiment.head_camera, scene.embodiment.head_camera)
        for side in SIDES:
            np.testing.assert_array_equal(
                again.embodiment.arms[side].base, scene.embodiment.arms[side].base
            )
    cameras = {tuple(scene.embodiment.head_camera) for scene in stages}
    assert len(cameras) == len({table_drop(scene.spec) for scene in stages}) == len(stages)


def test_a_randomized_attempt_repeats_to_the_byte(rollout):
    again = attempt(spec(), Recipe())
    for key in ("poses", "qpos", "action", "contacts"):
        assert (
            getattr(rollout.replay.log, key).tobytes() == getattr(again.replay.log, key).tobytes()
        )
    assert again.motion.to_json() == rollout.motion.to_json()


# --- clutter
# ------------------------------------------------------------------------------------------


def outline(body, n=24):
    """Points (K,2) along the border of a body's bounding box, seen from above."""
    (x0, y0, _), (x1, y1, _) = body.instance.shape().aabb()
    u = np.linspace(0, 1, n)[:, None]
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    edges = [a + u * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    return transform(body.pose, np.hstack([np.concatenate(edges), np.zeros((4 * n, 1))]))[:, :2]


def apart(a, b):
    return np.linalg.norm(outline(a)[:, None] - outline(b)[None], axis=-1).min()


def test_clutter_stands_on_the_table_out_of_the_way(stages):
    numbers = []
    for scene in stages:
        others = [scene.bodies[name] for name in scene.clutter]
        numbers.append(len(others))
        for body in others:
            points = outline(body)
            assert (np.abs(points) <= np.array(TABLE_HALF) - CLUTTER_GAP).all()
            in_front = ((points > HANDS[0]) & (points < HANDS[1])).all(1).any()
            assert not in_front or body.instance.shape().aabb()[1, 2] <= LOW
            assert body.pose[2] == TABLE_TOP
            for name in scene.bodies.keys() - set(scene.clutter):
                assert apart(body, scene.bodies[name]) >= TASK_GAP
        for a, b in combinations(others, 2):
            assert apart(a, b) >= CLUTTER_GAP
    assert min(numbers) >= CLUTTER[0]
    assert max(numbers) == CLUTTER[1]
    assert len(set(numbers)) >= 4


def test_clutter_keeps_clear_of_the_arms_at_home(stages):
    for scene in stages:
        for body in (scene.bodies[name] for name in scene.clutter):
            top, points = TABLE_TOP + body.instance.shape().aabb()[1, 2], outline(body)
            for side in SIDES:
                arm = scene.embodiment.arms[side]
                at = arm_poses(arm, arm.home)
                for corners in (
                    transform(at[x.name], piece.support_points())
                    for x in arm.links
                    for piece in x.collision
                ):
                    low, high = corners.min(0) - ARM_GAP, corners.max(0) + ARM_GAP
                    assert (
                        low[2] > top or not ((points > low[:2]) & (points < high[:2])).all(1).any()
                    )


def test_clutter_is_of_other_kinds_than_the_tasks_own_bodies(stages):
    for scene in stages:
        own = [body for name, body in scene.bodies.items() if name not in scene.clutter]
        names = {
            word
            for b in own
            for word in (*b.family.split("_"), *b.instance.words().noun.lower().split())
        }
        families = [scene.bodies[name].family for name in scene.clutter]
        assert len(set(families)) == len(families)
        assert not names & {word for family in families for word in family.split("_")}


def test_every_kind_of_clutter_is_small_and_stays_where_it_is_put():
    bodies = {
        "target": Body(
            "target",
            "block",
            FAMILIES["block"].draw(np.random.default_rng(0)),
            yawed((0, -0.2, TABLE_TOP), 0),
        )
    }
    for i, family in enumerate(CLUTTER_FAMILIES):
        instance = FAMILIES[family].draw(np.random.default_rng(i))
        assert len(instance.shape().collision) <= 5
        at = (0.2 * (i % 6) - 0.5, 0.17 * (i // 6) - 0.28, TABLE_TOP)
        bodies[family] = Body(family, family, instance, yawed(at, 0.3 * i))
    away = PlanarMotion.still(yawed((0, 0, 2.0), 0), 1.0)
    s = Simulation(get_embodiment("aloha"), tuple(bodies.values()), "target", away)
    assert s.settle()
    for _ in range(120):
        s.step(s.home_vector(), np.zeros(len(s.command)))
    for family in CLUTTER_FAMILIES:
        assert np.linalg.norm(s.pose(family)[:3] - bodies[family].pose[:3]) < 1e-3, family
        assert angle_between(s.pose(family)[3:], bodies[family].pose[3:]) < 0.02, family


def test_fewer_distractors_where_there_is_no_room(monkeypatch, stages):
    monkeypatch.setattr("pipeline.stages.surroundings.TASK_GAP", 0.5)
    numbers = [
        len(clutter(s.spec, {s.task.target: s.bodies[s.task.target]}, s.embodiment))
        for s in stages[:8]
    ]
    assert min(numbers) < CLUTTER[0]


def test_a_recipe_may_want_other_numbers_of_distractors():
    found = [
        len(build_scene(spec(seed=seed), Recipe(clutter=(9, 10)).ruling()).clutter)
        for seed in range(4)
    ]
    assert max(found) in (9, 10) and min(found) > CLUTTER[0]
    assert build_scene(spec(), Recipe(clutter=(0, 0)).ruling()).clutter == ()


def test_only_an_unusual_number_of_distractors_is_written(rollout):
    usual = episode_of(rollout, Recipe(), DRAWING, KEYS).meta
    assert "clutter_wanted" not in usual.model_dump_json()
    other = usual.model_copy(update={"clutter_wanted": (0, 10)})
    again = EpisodeMeta.model_validate_json(other.model_dump_json())
    assert again == other and EpisodeMeta.model_validate_json(usual.model_dump_json()) == usual
    assert rules_of(again) == replace(rules_of(usual), clutter=(0, 10))
    assert rules_of(again).label.endswith("clutter0to10")


@pytest.mark.parametrize("kind", ["domain", "randomized"])
def test_looks_are_drawn_from_the_textures_that_the_recipe_names(kind):
    for seed in range(5):
        seen, unseen = (
            visuals_of(spec(seed=seed), Setup(visuals=kind, textures=split))
            for split in ("seen", "unseen")
        )
        for before, after in (
            (seen.table, unseen.table),
            (seen.wall, unseen.wall),
            (seen.ground, unseen.ground),
        ):
            assert before == after or (before.seed % 2, after.seed % 2) == (0, 1)
        assert (seen.sun, seen.ambient) == (unseen.sun, unseen.ambient)
        assert visuals_of(spec(seed=seed), Setup(visuals=kind)) == seen


def test_hidden_is_what_a_cylinder_covers():
    rng, camera = np.random.default_rng(3), np.array([0.0, -0.45, 1.35, 1, 0, 0, 0])
    body = Body("c", "can", FAMILIES["can"].draw(rng), yawed((0.1, 0.05, TABLE_TOP), 0.4))
    shape = body.instance.shape()
    radius, top = shape.footprint_radius(), TABLE_TOP + shape.aabb()[1, 2]
    points = rng.uniform((-0.2, -0.2, TABLE_TOP), (0.4, 0.5, TABLE_TOP + 0.1), (3000, 3))
    along = np.linspace(0, 1, 3000)[:, None]
    found = occluded([body], camera, points)
    assert 0.02 < found.mean() < 0.5
    for point, is_hidden in zip(points, found, strict=True):
        ray = point + along * (camera[:3] - point)
        depth = radius - np.linalg.norm(ray[:, :2] - body.pose[:2], axis=1)[ray[:, 2] <= top]
        deepest = depth.max() if len(depth) else -1.0
        assert is_hidden == (deepest > 0) or abs(deepest) < 1e-3
    assert not occluded([], camera, points).any()


def test_path_and_planner_take_clutter_for_obstacles(rollout):
    scene, log = rollout.scene, rollout.replay.log
    assert scene.clutter
    meeting = log.times <= rollout.meeting
    middles = log.pose("bell")[meeting, :3] + middle(
        scene.bodies["bell"].pose, scene.bodies["bell"].instance
    )
    middles -= scene.bodies["bell"].pose[:3]
    assert scene.sees(middles).all()
    actor = scene.start(rollout.motion, 15, "test")
    assert set(scene.clutter) <= set(actor.planning_scene().obstacles)
    reach = scene.bodies["bell"].instance.shape().footprint_radius()
    for name in scene.clutter:
        near = np.linalg.norm(
            log.pose("bell")[meeting, :2] - scene.bodies[name].pose[:2], axis=1
        ).min()
        assert near > 0.8 * (reach + scene.bodies[name].instance.shape().footprint_radius())


def test_an_attempt_whose_arm_hides_the_target_is_refused_where_that_is_asked(rollout):
    scene, log = rollout.scene, rollout.replay.log
    require_view(rollout, Setup())
    hidden, at = log.poses.copy(), log.pose(scene.task.target)[:, :3]
    before = at + 0.15 * (scene.embodiment.head_camera[:3] - at)
    for link in scene.embodiment.arms["left"].links:
        middle_of_link = (
            np.mean([mesh.vertices.mean(0) for mesh, _ in link.visual], axis=0)
            if link.visual
            else np.zeros(3)
        )
        hidden[:, log.bodies.index(f"left_{link.name}")] = [
            compose(pose(p), pose(-middle_of_link)) for p in before
        ]
    behind = replace(rollout, replay=replace(rollout.replay, log=replace(log, poses=hidden)))
    with pytest.raises(Failure, match=r"view: occluded .in 100 % of the last 0\.5 s") as refused:
        require_view(behind, Setup(cameras=(), size=(64, 48)))
    assert refused.value.steps == rollout.steps and refused.value.log is not None
    # a link that is in the way after the meeting, or long before it, is none
    met = log.time_of("meeting")
    for others in (log.times > met, log.times < met - 0.5):
        some = np.where(others[:, None, None], hidden, log.poses)
        require_view(
            replace(rollout, replay=replace(rollout.replay, log=replace(log, poses=some))), Setup()
        )


def test_an_episode_leaves_clutter_alone(rollout):
    scene, log = rollout.scene, rollout.replay.log
    assert scene.clutter and "clutter_touched" not in {event.name for event in log.events}


def test_instructions_and_episode_tell_clutter_from_the_task(rollout):
    episode = episode_of(rollout, Recipe(), DRAWING, KEYS)
    assert episode.meta.clutter == rollout.scene.clutter
    assert set(rollout.scene.clutter) | {"bell"} == set(episode.meta.objects)
    phrases = {
        words
        for name in rollout.scene.clutter
        for words in rollout.scene.bodies[name].instance.words().seen
    }
    assert not any(
        phrase in sentence for phrase in phrases for sentence in episode.instructions["seen"]
    )


# --- table height and head camera
# ------------------------------------------------------------------------------------------


def test_a_lower_table_is_a_robot_that_stands_higher(stages):
    plain = get_embodiment("aloha")
    for scene in stages:
        drop, e = table_drop(scene.spec), scene.embodiment
        assert 0 < drop < TABLE_DROP
        for side in SIDES:
            np.testing.assert_allclose(
                e.arms[side].base - plain.arms[side].base, [0, 0, drop, 0, 0, 0, 0], atol=1e-12
            )
    bottom = min(mesh.vertices[:, 2].min() for mesh, _ in plain.furniture)
    top = max(mesh.vertices[:, 2].max() for mesh, _ in plain.furniture)
    higher = raised(plain, 0.03)
    assert min(mesh.vertices[:, 2].min() for mesh, _ in higher.furniture) == pytest.approx(
        bottom, abs=1e-3
    )
    assert max(mesh.vertices[:, 2].max() for mesh, _ in higher.furniture) == pytest.approx(
        top + 0.03, abs=1e-5
    )
    np.testing.assert_allclose(
        [c.pose[2] for c in higher.furniture_collision],
        [c.pose[2] + 0.03 for c in plain.furniture_collision],
        atol=1e-12,
    )


def test_the_head_camera_moves_a_little(stages):
    plain = get_embodiment("aloha").head_camera
    shifts, turns = [], []
    for scene in stages:
        camera = scene.embodiment.head_camera - [0, 0, table_drop(scene.spec), 0, 0, 0, 0]
        shifts.append(transform(inverse(plain), camera[:3]))
        turns.append(angle_between(plain[3:], camera[3:]))
    assert (np.abs(shifts) <= CAMERA_SHIFT).all()
    assert np.abs(shifts).max() > 0.5 * CAMERA_SHIFT
    assert CAMERA_TURN / 2 < max(turns) <= CAMERA_TURN * np.sqrt(3) * 1.01
    for scene in stages:
        target = scene.bodies[scene.task.target]
        assert scene.sees(middle(target.pose, target.instance))


def test_the_episode_records_the_camera_it_was_seen_from(rollout, tmp_path):
    scene, log = rollout.scene, rollout.replay.log
    views = render(appearance_of(scene, Setup(cameras=("head",), render="raster-fast")), log)
    write_episode(tmp_path / "e.hdf5", episode_of(rollout, Recipe(), DRAWING, KEYS), views)
    with open_episode(tmp_path / "e.hdf5") as file:
        recorded = file.array("observation/head_camera/extrinsic_cv")
    head = cameras_of(scene.embodiment)[0]
    np.testing.assert_allclose(
        recorded, np.repeat(extrinsics_cv(head.pose)[None], len(log), 0), atol=1e-6
    )
    clean = extrinsics_cv(get_embodiment("aloha").head_camera)
    assert np.abs(recorded[0] - clean).max() > 1e-3
