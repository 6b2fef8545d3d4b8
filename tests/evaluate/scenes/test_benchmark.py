"""Benchmark files: scenes that are the same as those drawn from their seeds, and files that are
none."""

import json
import lzma
from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.recipe.model import Cell, Recipe
from pipeline.data.setup import Setup
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.benchmark import pack, read_benchmark, unpack_benchmark
from pipeline.evaluate.scenes.case import BenchmarkError, Case, expert, log_hash, start_hash
from pipeline.evaluate.scenes.frozen import freeze
from pipeline.evaluate.scenes.manifests import SeedJob, try_seed
from pipeline.evaluate.scenes.trial import Trial, instruction_of
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.stages.drawing.render import visuals_of
from pipeline.stages.scene import build_scene
from pipeline.tasks.contract import expand_tasks

SETUP = Setup().physics
PARTS = {"bells": ["click_bell"]}
CELLS = [
    *(Cell("click_bell", "aloha-agilex", level, 0.1, "clean") for level in range(4)),
    *(Cell("place_empty_cup", "aloha-agilex", level, 0.1, "clean") for level in (0, 2)),
    *(Cell("click_bell", "aloha-agilex", level, 0.1, "randomized") for level in (1, 3)),
]


def first_case(cell):
    found = (try_seed(SeedJob(cell, seed, SETUP)) for seed in range(20))
    return next(case for case in found if isinstance(case, Case))


@pytest.fixture(scope="module")
def cases():
    return {cell: [first_case(cell)] for cell in CELLS}


@pytest.fixture(scope="module")
def packed(cases):
    return pack("small", cases, SETUP, PARTS, {})


@pytest.fixture(scope="module")
def frozen(packed):
    return unpack_benchmark(packed, "small")


def log_of(case):
    """What the expert's actions do in the scene of a case."""
    trial = Trial(case.scene(), case.target_motion)
    first = start_hash(trial.simulation.poses(), trial.simulation.qpos()[0])
    for action in expert(replace(case, state=None).spec).replay.log.action[:-1]:
        if not trial.ending:
            trial.advance(action)
    return first, log_hash(trial.log()), trial.ending


def test_a_scene_from_the_file_moves_as_the_one_from_its_seed(cases, frozen):
    read = frozen.cases(CELLS, 1)
    for cell in CELLS:
        drawn, thawed = cases[cell][0], read[cell][0]
        assert drawn.state is None and thawed.state is not None
        assert replace(thawed, state=None) == drawn
        one, other = log_of(drawn), log_of(thawed)
        assert one == other
        assert one[0] == drawn.start


def test_a_scene_from_the_file_is_drawn_and_told_as_the_one_from_its_seed(cases, frozen):
    read, setup = frozen.cases(CELLS, 1), Setup(textures="unseen")
    for cell in CELLS:
        drawn, thawed = cases[cell][0].scene(), read[cell][0].scene()
        assert np.array_equal(drawn.embodiment.head_camera, thawed.embodiment.head_camera)
        assert visuals_of(drawn.spec, setup) == visuals_of(drawn.spec, setup, frozen=thawed.looks)
        for split in ("seen", "unseen"):
            assert instruction_of(drawn, split) == instruction_of(thawed, split)
        assert (drawn.arms, drawn.clutter) == (thawed.arms, thawed.clutter)


@pytest.mark.parametrize("domain", ["clean", "randomized"])
def test_every_task_can_be_frozen(domain):
    for task in expand_tasks(["all", "beyond", "decide"]):
        spec = SeedJob(Cell(task, "aloha-agilex", 1, 0.1, domain), 3).spec
        scene = build_scene(spec)
        thawed = freeze(scene).scene(spec, scene.rules)
        assert [*thawed.bodies] == [*scene.bodies]
        for name, body in scene.bodies.items():
            again = thawed.bodies[name]
            assert np.array_equal(body.pose, again.pose)
            for part in ("family", "instance", "fixed", "inside", "slide", "borne"):
                assert getattr(body, part) == getattr(again, part)


def test_a_file_is_the_same_whatever_the_order_of_the_workers(cases, packed, tmp_path):
    assert pack("small", dict(cases), SETUP, PARTS, {}) == packed
    path = tmp_path / "own.jsonl.xz"
    path.write_bytes(packed)
    assert read_benchmark(str(path)).sha256 == unpack_benchmark(packed, "").sha256


def test_an_episode_on_a_benchmark_states_it(frozen):
    case = frozen.cases(CELLS[1:2], 1)[CELLS[1]][0]
    job = EpisodeJob(case, PolicyName("still", "still"), parse_clock("late:0"))
    plain, row = (run_episode(each) for each in (job, replace(job, benchmark=frozen.label)))
    assert row["benchmark"] == frozen.label
    assert {**row, "seconds_spent": None, "benchmark": None} == {
        **plain,
        "seconds_spent": None,
        "benchmark": None,
    }
    assert job.key != replace(job, benchmark=frozen.label).key


def test_a_swap_has_the_same_body_in_a_scene_from_the_file_and_from_its_seed(cases, frozen):
    setup = Setup(cameras=(), events=("swap@0.2",))
    for cell in (CELLS[1], CELLS[6]):  # the second has distractors
        (own,), (case,) = cases[cell], frozen.cases([cell], 1)[cell]
        one, two = own.scene(setup), case.scene(setup)
        assert [*one.bodies] == [*two.bodies]
        assert one.bodies["event_swap"].instance == two.bodies["event_swap"].instance
        trial = Trial(two, case.target_motion, setup)
        trial.hold(60)
        assert trial.simulation.roles["bell"] == "event_swap"


def test_a_part_is_chosen_by_name_and_by_options(frozen):
    recipe = Recipe(tasks=("click_bell",), levels=(1, 3), domains=("clean",), alpha=(0.3,))
    assert frozen.choose(recipe, ["cameras"]) == CELLS
    assert frozen.choose(recipe, ["tasks", "levels", "domains"]) == [CELLS[1], CELLS[3]]
    assert [cell.task for cell in frozen.only("bells").choose(recipe, [])] == (["click_bell"] * 6)
    still = recipe.model_copy(update={"levels": (0, 1)})
    assert frozen.choose(still, ["alpha", "levels"]) == [CELLS[0], CELLS[4]]
    with pytest.raises(BenchmarkError, match="no scene"):
        frozen.choose(recipe, ["tasks", "alpha", "levels"])
    every = recipe.model_copy(update={"tasks": expand_tasks(["all"])})
    assert frozen.choose(every, ["tasks"], ["all"]) == CELLS
    with pytest.raises(BenchmarkError, match="shake_bottle is not in benchmark small: click_bell"):
        frozen.choose(every, ["tasks"], ["click_bell", "shake_bottle"])
    with pytest.raises(BenchmarkError, match="has 1 scenes"):
        frozen.cases(CELLS, 2)
    assert frozen.count_scenes(None) == frozen.count_scenes(1) == 1


def test_its_physics_hold(frozen):
    wanted = Setup(cameras=("head",), size=(64, 48), lead=0.5)
    assert frozen.under(wanted, ["cameras"]) == wanted.override({"lead": 0.0})
    with pytest.raises(BenchmarkError, match="has fps 15, not 30"):
        frozen.under(Setup(fps=30), ["fps"])


def edited(packed, change, number=1):
    """The file with a change to the values of one of its lines."""
    lines = lzma.decompress(packed).splitlines()
    values = json.loads(lines[number])
    change(values)
    lines[number] = json.dumps(values).encode()
    return lzma.compress(b"\n".join(lines) + b"\n")


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v.pop("motion"),
        lambda v: v.update(seed=-1),
        lambda v: v.update(more=1),
        lambda v: v.update(start="../.."),
        lambda v: v.update(meeting=v["meeting"] + 1),
        lambda v: v.update(frames=1),
        lambda v: v["motion"].update(model="none"),
        lambda v: v["motion"].update(duration=float("nan")),
        lambda v: v["state"]["bodies"].clear(),
        lambda v: v["state"]["bodies"][0]["pose"].__setitem__(0, 1e9),
        lambda v: v["state"]["bodies"][0]["pose"].__setitem__(0, 0.3),
        lambda v: v["state"]["looks"].pop("sun"),
    ],
)
def test_a_line_that_is_no_scene_is_refused(packed, change):
    with pytest.raises(BenchmarkError, match="line 2 is no scene"):
        unpack_benchmark(edited(packed, change), "x").cases(CELLS, 1)


@pytest.mark.parametrize(
    "change",
    [
        lambda b: b[0].update(family="os"),
        lambda b: b[0]["parameters"].update(more=1.0),
        lambda b: b[0]["parameters"].update({next(iter(b[0]["parameters"])): 1e9}),
        lambda b: b[0].update(inside="nowhere"),
        lambda b: b.append(b[0]),
        lambda b: b[0]["parameters"].update(
            {name: "no colour" for name, value in b[0]["parameters"].items() if value == str(value)}
        ),
    ],
)
def test_a_state_that_is_none_is_refused(packed, change):
    data = edited(packed, lambda v: change(v["state"]["bodies"]))
    (case,) = unpack_benchmark(data, "x").cases(CELLS[:1], 1)[CELLS[0]]
    with pytest.raises(BenchmarkError, match="click_bell, level 0"):
        case.scene()


@pytest.mark.parametrize(
    "change",
    [
        lambda head: head.update(benchmark="../x"),
        lambda head: head.update(physics_hz=100),
        lambda head: head.update(setup={"rules": "none"}),
        lambda head: head["cells"].pop(),
        lambda head: head["cells"].append(head["cells"][0]),
        lambda head: head["cells"][0].update(task="../../x"),
        lambda head: head["cells"][0].update(task="no_task"),
        lambda head: head.update(scenes=10**6),
    ],
)
def test_a_head_that_is_none_is_refused(packed, change):
    with pytest.raises(BenchmarkError, match="is no benchmark"):
        unpack_benchmark(edited(packed, change, 0), "x")


def test_damaged_files_are_refused(packed, tmp_path):
    bomb = lzma.compress(bytes(1 << 29), preset=0)
    for data in (b"", b"x", packed[:-9], packed + b"x", bomb, lzma.compress(b"[]\n")):
        with pytest.raises(BenchmarkError, match="is no benchmark"):
            unpack_benchmark(data, "x")
    with pytest.raises(BenchmarkError, match="not compressed with xz"):
        unpack_benchmark(b'{"benchmark": "plain"}\n', "x")
    changed = bytearray(packed)
    changed[len(changed) // 2] ^= 1
    with pytest.raises(BenchmarkError):
        unpack_benchmark(bytes(changed), "x")
    with pytest.raises(BenchmarkError, match="no benchmark"):
        read_benchmark(str(tmp_path / "none"))
    path = tmp_path / "own"
    path.write_bytes(packed)
    with pytest.raises(BenchmarkError, match=r"has no part .none., but bells$"):
        read_benchmark(f"{path}:none")
