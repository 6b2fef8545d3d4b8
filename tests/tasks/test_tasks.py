"""What every registered task must keep, whichever it is: layout, arms, words, and one attempt still
and one at level 3."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.names import SIDES
from pipeline.data.process.own_code import Finding
from pipeline.data.setup import DEFAULT
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.check_task import check_task
from pipeline.motion.planar import PlanarMotion
from pipeline.poses import transform
from pipeline.stages.attempt import attempt
from pipeline.stages.back_calculate import back_calculate
from pipeline.stages.dry_run import dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.replay import replay
from pipeline.stages.scene import build_scene
from pipeline.tasks import INTERCEPTION, TASKS, TRACKING
from pipeline.tasks.contract import Task, expand_tasks, register
from pipeline.tasks.language.check import check_templates
from pipeline.tasks.language.sentences import instructions
from pipeline.tasks.layout import families_of
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Simulation
from tests.motion.jumps import velocity_jumps

NAMES = expand_tasks(())
SEEDS = range(6)
TRIES = 6
"""Attempts a task may need at level 0 and 3 until one is accepted."""

FIRST_SEED = {"dump_bin_bigbin": 1, "put_object_cabinet": 1, "scan_object": 1}
"""Where attempts begin, for tasks that seed 0 asks to try again: any other seed only takes
longer."""

PAGE = (
    (Path(__file__).parents[2] / "docs" / "add_a_task.md")
    .read_text()
    .split("## Names of conditions")[1]
    .split("\n## ")[0]
)
CONDITIONS = {
    name
    for row in re.findall(r"^\| (`.*?) \|", PAGE, re.MULTILINE)
    for name in re.findall(r"`(\w+)`", row)
}

every_task = pytest.mark.parametrize("name", NAMES)


def spec(name, seed=0, level=3, alpha=0.1):
    return EpisodeSpec(name, "aloha-agilex", level, alpha, "clean", 0, seed)


def calculate(scene, dry):
    return back_calculate(scene, dry, DEFAULT)


def accepted(name):
    """The first seed whose attempts at levels 0 and 3 both succeed, sharing one dry run, as they do
    in paired cells, and for which level 2 has a motion."""
    failures = []
    for seed in range(TRIES):
        try:
            scene = build_scene(spec(name, seed))
            dry = dry_run(scene, 15)
            still = replace(scene, spec=spec(name, seed, level=0))
            motions = calculate(still, dry), calculate(scene, dry)
            logs = tuple(
                replay(one, dry, motion, 15).log
                for one, motion in zip((still, scene), motions, strict=True)
            )
            calculate(replace(scene, spec=spec(name, seed, level=2)), dry)
        except Failure as failure:
            failures.append(str(failure))
        else:
            return SimpleNamespace(scene=scene, still=still, dry=dry, motions=motions, logs=logs)
    raise AssertionError(f"{name}: {TRIES} seeds failed: {failures}")


def paired(name, attempts):
    """As `accepted`, of the checker's attempts at both levels if they have one seed and one dry
    run."""
    one, other = attempts
    if one.scene.spec.seed != other.scene.spec.seed or one.dry is not other.dry:
        return accepted(name)
    try:
        calculate(replace(one.scene, spec=replace(one.scene.spec, level=2)), one.dry)
    except Failure:
        return accepted(name)
    motions, logs = (one.motion, other.motion), (one.log, other.log)
    return SimpleNamespace(
        scene=other.scene, still=one.scene, dry=one.dry, motions=motions, logs=logs
    )


@pytest.fixture
def attempts(monkeypatch):
    """What the contract checker's accepted attempts were made of, in order. The dry runs of one
    seed are made once for both levels. The checker leaves out what the tests of this folder check
    in more scenes: repetition, layouts and sentences."""
    noted, made, order = [], {}, []

    def dry_run_once(scene, *arguments):
        key = scene.spec.seed, len(order)
        if key not in made:
            made[key] = dry_run(scene, *arguments)
        order.append(made[key])
        return made[key]

    def noting_attempt(wanted, *arguments):
        order.clear()
        done = attempt(
            replace(wanted, seed=wanted.seed + FIRST_SEED.get(wanted.task, 0)), *arguments
        )
        noted.append(
            SimpleNamespace(
                scene=done.scene, dry=order[-1], motion=done.motion, log=done.replay.log
            )
        )
        return done

    monkeypatch.setattr("pipeline.stages.attempt.dry_run", dry_run_once)
    monkeypatch.setattr("pipeline.intake.check_task.attempt", noting_attempt)
    for part, found in (("_determinism", (Finding("determinism", True, ""),)), ("_layouts", ())):
        monkeypatch.setattr(f"pipeline.intake.check_task.{part}", lambda *_, found=found: found)
    return noted


def rectangle(body):
    low, high = body.instance.shape().aabb()
    corners = [
        [x, y, 0]
        for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
    ]
    return transform(body.pose, np.array(corners))[:, :2]


def overlap(a, b):
    """Whether two convex outlines (4,2) share a point: brute force over a grid of both."""
    u = np.linspace(0, 1, 25)
    grid = [
        (1 - s) * ((1 - t) * a[0] + t * a[1]) + s * ((1 - t) * a[3] + t * a[2])
        for s in u
        for t in u
    ]
    edges = np.roll(b, -1, 0) - b
    inside = np.cross(edges[None], np.array(grid)[:, None] - b[None]) >= 0
    return bool(inside.all(1).any())


# --- the scene
# ------------------------------------------------------------------------------------------


@every_task
def test_bodies_stand_in_their_regions_and_apart_and_mirrored_tasks_use_both_arms(
    name, monkeypatch
):
    layout, drawn, scenes = TASKS[name].layout, [], []

    def recorded(draw):
        drawn.clear()  # a layout without room is drawn again: the last one is the scene
        for placement in layout(draw):
            drawn.append(placement)
            yield placement

    families_of(TASKS[name])  # draws layouts of its own the first time
    monkeypatch.setattr(TASKS[name], "layout", recorded)
    for seed in SEEDS:
        scene = build_scene(spec(name, seed))
        scenes.append(scene)
        assert scene.task.target in scene.bodies
        assert scene.task.manipulated in scene.bodies
        bodies = list(scene.bodies.values())
        for placement, body in zip(drawn, bodies, strict=True):
            assert body.name == placement.name
            assert isinstance(body.instance, FAMILIES[body.family])
            if body.inside or (body.fixed and body.pose[2] == 0.0):
                continue  # rides in another body, or stands on the floor beside the table
            assert body.pose[2] >= TABLE_TOP
            assert (np.abs(rectangle(body)) <= TABLE_HALF).all(), (
                f"{body.name} stands over the edge"
            )
            (x0, x1), (y0, y1) = sorted(placement.region.x), sorted(placement.region.y)
            assert x0 <= body.pose[0] <= x1
            assert y0 <= body.pose[1] <= y1
            assert abs(body.pose[0]) >= placement.region.away_from_centre
        bodies = [body for body in bodies if not body.inside]
        for i, a in enumerate(bodies):
            for b in bodies[i + 1 :]:
                assert not overlap(rectangle(a), rectangle(b)), (
                    f"seed {seed}: {a.name} overlaps {b.name}"
                )
        target = scene.bodies[scene.task.target]
        assert not target.fixed
        assert scene.task.workspace.contains(target.pose), (
            f"seed {seed}: the target does not stand in its workspace"
        )
        assert scene.arms
        assert set(scene.arms.values()) <= set(SIDES)
    xs = [scene.bodies[scene.task.target].pose[0] for scene in scenes]
    if len(scenes[0].arms) == 1 and min(xs) < -0.05 and max(xs) > 0.05:
        used = {side for scene in scenes for side in scene.arms.values()}
        assert used == set(SIDES), "targets stand on both sides, one arm does all"


@every_task
def test_a_scene_follows_from_its_seed_and_not_from_level_or_alpha(name):
    poses = [
        {n: (b.family, b.instance, *b.pose) for n, b in build_scene(s).bodies.items()}
        for s in (spec(name, 1), spec(name, 1, level=0, alpha=0.3), spec(name, 2))
    ]
    assert poses[0] == poses[1]
    assert poses[0] != poses[2]


@every_task
def test_the_task_describes_itself(name):
    task = TASKS[name]
    scene = build_scene(spec(name))
    assert task.name == name
    assert task.category in (INTERCEPTION, TRACKING)
    assert (task.manipulated == task.target) == (
        task.category == INTERCEPTION
    ) or task.category == TRACKING
    assert 0 < task.step_limit <= 2000
    check_templates(task.seen, task.unseen, list(scene.bodies), list(scene.arms))
    assert (task.least_seen, task.least_unseen) == (Task.least_seen, Task.least_unseen), (
        "the contract says how many"
    )
    assert any(t.startswith("~") for t in task.seen)
    for templates, least in ((task.seen, task.least_seen), (task.unseen, task.least_unseen)):
        assert len(templates) >= least
        assert sum(not t.startswith("~") for t in templates) >= least / 2


@every_task
def test_instructions_are_true_of_their_scene(name):
    for seed in range(2):
        scene = build_scene(spec(name, seed))
        words = {n: b.instance.words() for n, b in scene.bodies.items()}
        text = instructions(scene.wording(), scene.spec.rng("language"), 20)
        for split in ("seen", "unseen"):
            assert len(text[split]) == 20
            for sentence in text[split]:
                assert not re.search(r"[{}]", sentence)
                for side in re.findall(r"\b(left|right) arm\b", sentence):
                    assert side in scene.arms.values(), sentence
                named = [
                    n
                    for n, w in words.items()
                    for phrase in getattr(w, split)
                    if phrase in sentence
                ]
                assert named, f"{sentence!r} names no object of the scene"
        assert not set(text["seen"]) & set(text["unseen"])


@every_task
def test_nothing_is_solved_before_it_begins(name):
    for seed in (1,):
        scene = build_scene(spec(name, seed))
        body = scene.bodies[scene.task.target]
        s = Simulation(
            scene.embodiment,
            tuple(scene.bodies.values()),
            body.name,
            PlanarMotion.still(body.pose, 1.0),
        )
        recorder = Recorder(s, 15)
        for _ in range(80):
            s.step(s.home_vector(), np.zeros(len(s.command)))
            recorder.after_step()
        assert not scene.succeeded(recorder.log())
        for condition in scene.conditions(recorder.log()):
            assert documented(condition, scene.bodies), (
                f"docs/add_a_task.md has no condition {condition!r}"
            )


def documented(condition, bodies):
    """Whether the page lists the name of a condition, as it is or behind the name of a body."""
    own = next(
        (condition.removeprefix(f"{body}_") for body in bodies if condition.startswith(f"{body}_")),
        condition,
    )
    return (
        condition in CONDITIONS
        or own in CONDITIONS
        or re.sub("^(on|met_by)_", "", condition) in {*bodies, "table"}
    )


def keeps_its_conditions(scene, log):
    """All true from the time of success on, at every fifth frame, and not the frame before. What
    holds of each frame's conditions is a finding of the contract checker."""
    outcome = scene.outcome(log)
    success = int(np.argmax(log.times >= log.time_of("success")))
    lengths = sorted({success, success + 1, len(log), *range(success + 1, len(log) + 1, 5)})
    per_frame = [scene.task.conditions(outcome.until(frames), scene.arms) for frames in lengths]
    assert per_frame[-1] == scene.conditions(log)
    true = [all(conditions.values()) for conditions in per_frame]
    assert true == [frames > success for frames in lengths]


# --- attempts
# ------------------------------------------------------------------------------------------


@every_task
def test_the_contract_is_kept_and_attempts_at_level_0_and_3_are_what_their_level_says(
    name, attempts
):
    bad = [finding for finding in check_task(name, levels=(0, 3)) if not finding.ok]
    assert not bad, bad
    a = paired(name, attempts)
    end = a.scene.bodies[a.scene.task.target].pose
    still, moving = a.motions
    for motion in a.motions:
        np.testing.assert_allclose(motion.pose(a.dry.meeting), end, atol=1e-9)
    assert still.maximum_speed() == 0
    assert 0 < moving.average_speed() <= 0.1 * (1 + 1e-9)
    assert velocity_jumps(moving).max() > 0.01
    for scene, motion, log in zip((a.still, a.scene), a.motions, a.logs, strict=True):
        assert scene.succeeded(log)
        keeps_its_conditions(scene, log)
        release = log.time_of("release")
        assert log.time_of("meeting") == release
        assert abs(release - a.dry.meeting) < 0.15
        held = log.times < release
        gap = np.linalg.norm(
            log.pose(scene.task.target)[held, :3] - motion.position(log.times[held]), axis=1
        )
        assert gap.max() < 1e-3
        assert log.time_of("success") <= log.times[-1]
        assert len(log) <= scene.task.step_limit + 1

    slow = replace(a.scene, spec=replace(a.scene.spec, alpha=0.0))
    assert calculate(slow, a.dry).to_json() == still.to_json()


@pytest.mark.parametrize("name", ["click_bell", "place_phone_stand", "handover_mic"])
def test_a_dry_run_is_the_same_bytes_at_every_level(name):
    one, other = (dry_run(build_scene(spec(name, level=level)), 15) for level in (0, 3))
    for key in ("commands", "velocities", "sweep"):
        assert getattr(one, key).tobytes() == getattr(other, key).tobytes(), key
    assert (one.steps, one.meeting) == (other.steps, other.meeting)


def test_alpha_0_gives_the_same_log_as_level_0():
    name = "click_bell"
    a = accepted(name)
    slow = build_scene(spec(name, a.scene.spec.seed, level=3, alpha=0.0))
    dry = dry_run(slow, 15)
    log = replay(slow, dry, calculate(slow, dry), 15).log
    for key in ("poses", "qpos", "qvel", "state", "action", "tcp", "contacts"):
        assert getattr(log, key).tobytes() == getattr(a.logs[0], key).tobytes(), key
    assert log.events == a.logs[0].events


def test_tasks_keep_no_state():
    for task in TASKS.values():
        assert not vars(task), f"{task.name} carries state from episode to episode"


def test_a_task_without_a_success_condition_cannot_be_registered():
    whole = type(TASKS["click_bell"])
    parts = {
        n: getattr(whole, n)
        for n in ("category", "target", "seen", "unseen", "layout", "arms", "meet")
    }
    with pytest.raises(TypeError, match="success"):
        register(type("HalfATask", (Task,), parts))
    assert "half_a_task" not in TASKS


@pytest.mark.parametrize("split", ["seen", "unseen"])
def test_a_task_with_too_few_templates_cannot_be_registered(split):
    whole = TASKS["click_bell"]
    least = getattr(Task, f"least_{split}")
    short = type(
        "ShortOfWords",
        (type(whole),),
        {"seen": whole.seen, "unseen": whole.unseen, split: whole.seen[: least - 1]},
    )
    with pytest.raises(ValueError, match=f"{least - 1} {split} templates: write at least {least}"):
        register(short)
    assert "short_of_words" not in TASKS


def test_a_taken_name_cannot_be_registered_again():
    click_bell = TASKS["click_bell"]
    with pytest.raises(ValueError, match="task 'click_bell' is registered twice"):
        register(type("ClickBell", (type(click_bell),), {}))
    assert TASKS["click_bell"] is click_bell
