"""One network for several tasks: sentences say what is found, two bodies are tracked, and a run is
made of commands that resume."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.data.recipe.model import RecipeError
from pipeline.export import EXPORTERS, Job
from tests.synthetic import episode_path, make_episode
from tests.training.puma.test_track import SIGHT, small
from tests.training.puma.test_train import seen, start
from training.puma.cli import app
from training.puma.config import Config, parse_config
from training.puma.corpus.mixture import open_corpus
from training.puma.corpus.samples import batch_of
from training.puma.corpus.split import pooled
from training.puma.errors import TrainError
from training.puma.finding import tracking
from training.puma.finding.tracking import with_tracks
from training.puma.many import Many, MisledPolicy, commands, estimate
from training.puma.many_table import table, twins
from training.puma.measure.checks import errors, replay_check
from training.puma.model.finder import FinderNet, finding_loss, learn_tasks
from training.puma.model.puma import build_model
from training.puma.model.text import HashedWords
from training.puma.model_keys import Finder
from training.puma.policy import PumaPolicy
from training.puma.track import Tracks, aim_numbers, aims
from training.puma.train import FINDER, sizes_of, train


def test_pieces_of_words_are_what_unseen_words_have_in_common():
    words = HashedWords(4096, pieces=True)
    lists = [{*row[row >= 0].tolist()} for row in words.ids(["Ring bells", "ring the bell", "cup"])]
    assert len(lists[0] & lists[1]) >= 5 and not lists[0] & lists[2]
    assert HashedWords(4096).ids(["ring the bell"]).ge(0).sum() == 3


def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An image with a red and a blue square on grey, and the middle (2,2) px of either."""
    image = np.full((96, 128, 3), 90, np.uint8)
    middles = np.array([rng.uniform((16, 16), (52, 80)), rng.uniform((76, 16), (112, 80))])
    if rng.random() < 0.5:
        middles = middles[::-1]
    for (x, y), colour in zip(middles.astype(int), ((220, 40, 40), (40, 40, 220)), strict=True):
        image[y - 4 : y + 4, x - 4 : x + 4] = colour
    return image, middles


def test_the_sentence_says_which_of_two_bodies_is_found():
    torch.manual_seed(0)
    rng, words = np.random.default_rng(0), HashedWords(512, pieces=True)
    settings = Finder(size=(48, 64), crop=32, width=8, words=8)
    finder = FinderNet(settings, 512)
    optimizer = torch.optim.AdamW(finder.parameters(), 1e-2)
    names = ("take the red block", "take the blue block")

    def batch(count: int) -> tuple[list[np.ndarray], np.ndarray, list[int]]:
        scenes = [scene(rng) for _ in range(count)]
        which = rng.integers(2, size=count).tolist()
        return [image for image, _ in scenes], np.array([m for _, m in scenes]), which

    for _ in range(160):
        images, middles, which = batch(12)
        truth = middles[np.arange(12), which][:, None].repeat(3, 1)
        corners = finder.corners(truth[:, 0] + rng.uniform(-8, 8, (12, 2)), np.array([128, 96]))
        told = finder.read(words.ids([names[i] for i in which]))
        loss = torch.zeros(())
        for locator, shown, points in (
            (finder.coarse, finder.shrunk(images), truth / 2),
            (finder.fine, finder.crops(images, corners), truth - corners[:, None]),
        ):
            found, doubts = locator(torch.from_numpy(shown), told)
            there = torch.ones(found.shape[:2])
            loss = loss + finding_loss(found, doubts, torch.from_numpy(points).float(), there)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    images, middles, which = batch(32)
    finder.eval()

    def median(told: list[int], wanted: list[int]) -> float:
        points, _ = finder.find(np.stack(images), words.ids([names[i] for i in told]))
        away = points[:, 0] - middles[np.arange(32), wanted]
        return float(np.median(np.linalg.norm(away, axis=1)))

    swapped = [1 - i for i in which]
    assert median(which, which) < 2
    # told the other one, it finds the other one, and not its own
    assert median(swapped, swapped) < 2 and median(swapped, which) > 20


def test_an_unseen_sentence_is_taken_for_its_task_and_does_what_its_own_sentences_do():
    torch.manual_seed(0)
    rng, words = np.random.default_rng(0), HashedWords(512, pieces=True)
    names = (("ring", "bell"), ("lift", "bottle"))
    frames = ("{} the {}", "please {} that {} now", "{} a {} with the left arm", "go and {} the {}")
    known = [words.ids([frame.format(*name) for frame in frames]) for name in names]
    finder = FinderNet(Finder(size=(48, 64), crop=32, width=8, words=8), 512, 2)
    learn_tasks(finder, known, 120, 0)
    finder.eval()
    image = scene(rng)[0][None]
    own = [finder.find(image, ids[:1]) for ids in known]
    assert np.abs(own[0][0] - own[1][0]).max() > 1e-3
    unseen = (
        "kindly make this small shiny bell sound",
        "carefully raise up one heavy green bottle",
    )
    for number, (text, ids, expected) in enumerate(zip(unseen, known, own, strict=True)):
        told = words.ids([text])
        # more than half of it is in no sentence of training
        assert np.isin(told[told >= 0].numpy(), ids.numpy()).mean() < 0.5
        # a sentence is still taken for its task by a few of its pieces
        few = torch.where(torch.rand(200, ids.shape[1]) < 0.1, ids[1], -1)
        few = few[(few >= 0).any(1)]
        assert (finder.task_logits(few).argmax(1) == number).float().mean() > 0.8
        found = finder.find(image, told)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_tracks_follow_two_bodies_and_aims_have_the_way_to_each():
    tracks = Tracks(SIGHT, 2)
    for i in range(20):
        poses = np.array(
            [[0.1 + 0.05 * i / 15, 0, 0.76, 1, 0, 0, 0], [-0.1, 0.1, 0.76, 1, 0, 0, 0]]
        )
        tracks.see(i / 15, SIGHT.pixels(poses).reshape(6, 2), np.full(6, 0.3))
    target, goal = np.split(tracks.numbers, 2)
    assert target[:4] == pytest.approx([0.1 + 0.05 * 19 / 15, 0, 0.05, 0], abs=1e-2)
    assert goal[:4] == pytest.approx([-0.1, 0.1, 0, 0], abs=1e-3)
    assert tracks.speed == pytest.approx(0.05, abs=1e-2)
    tools = np.array([[[0, 0, 1.0], [0.2, 0.1, 1.0]]])
    found = aims(tracks.numbers[None], tools, 2)
    assert found.shape == (1, aim_numbers(3, 2))
    assert found[0, -4:] == pytest.approx([-0.1, 0.1, -0.3, 0.0], abs=1e-3)
    fine = aims(tracks.numbers[None], tools - [0, 0, 0.2], 2, near=True)
    assert fine.shape == (1, aim_numbers(3, 2, near=True))
    assert fine[0, -6:-2] == pytest.approx(np.tanh([-2.5, 2.5, -7.5, 0.0]), abs=0.03)
    assert fine[0, -2:] == pytest.approx(np.tanh([1.0, 1.0]), abs=1e-6)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Datasets of two tasks, exported with the poses of all objects."""
    out = list[Path]()
    for task in ("click_bell", "adjust_bottle"):
        root = tmp_path_factory.mktemp("many") / task
        paths = [episode_path(root, slot=slot, task=task) for slot in range(2)]
        for slot, path in enumerate(paths):
            make_episode(path, slot=slot, seed=slot, frames=9, cameras=("head_camera",), task=task)
        exporter = EXPORTERS["parquet"]
        options = exporter.options(labels=("poses",))
        exporter.export(Job(root, root / "exports" / "parquet", paths, options))
        out.append(root)
    return out


def several(datasets: list[Path], cache: Path) -> Config:
    values = small(datasets[0], cache, goal=True, words=8, nearest_task=True).model_dump(
        mode="json"
    )
    values["model"] |= {"touched": True, "modes": 2}
    values["data"] |= {"balance": "tasks", "validation": 0.5}
    first, second = ({"dataset": str(path)} for path in datasets)
    values["data"]["sources"] = [first, second | {"after_success": 0.2}]
    return parse_config(values, "test")


def test_a_network_of_two_tasks_trains_resumes_and_sees_what_it_was_trained_on(
    two: list[Path], cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    config = several(two, cache)
    train(config, tmp_path / "whole", quiet=True)
    train(config, tmp_path / "parts", steps=3, quiet=True)
    train(config, tmp_path / "parts", quiet=True)
    # of a run that was stopped just after it trained its finder, only that is left
    (tmp_path / "kept").mkdir()
    shutil.copy(tmp_path / "whole" / FINDER, tmp_path / "kept")
    with monkeypatch.context() as patched:
        patched.setattr(tracking, "train_finder", None)
        train(config, tmp_path / "kept", quiet=True)
    whole, *others = (
        (tmp_path / run / "checkpoints/step_00000006/model.safetensors").read_bytes()
        for run in ("whole", "parts", "kept")
    )
    assert [whole, whole] == others
    found = replay_check(tmp_path / "whole", None, 1)
    assert found["answers"] and not found["different"]
    policy = PumaPolicy.load(tmp_path / "whole")
    told = [MisledPolicy.load(tmp_path / "whole"), policy]
    assert isinstance(told[0], MisledPolicy)
    told[0].sentences = ("adjust bottle now",)
    for one in told:
        one.reset(start())
    answers = [np.concatenate([one.act(seen(k / 15)) for k in range(3)]) for one in told]
    assert np.abs(answers[0] - answers[1]).max() > 1e-6


def test_frames_of_all_datasets_in_one_part_make_the_same_batches(two: list[Path], cache: Path):
    config = several(two, cache)
    corpus = open_corpus(config)
    corpus = with_tracks(
        corpus,
        build_model(config, sizes_of(corpus)),
        lambda cache: np.repeat(np.asarray(cache.arrays["time"])[:, None], 16, 1),
    )
    whole, start = pooled(corpus.train), 0
    for part in corpus.train:
        places = np.arange(len(part))
        one = batch_of(part, places, config, corpus.preprocessing)
        same = batch_of(whole, places + start, config, corpus.preprocessing)
        texts = [part.cache.rows[row].instructions for row in one.pop("row")]
        assert texts == [whole.cache.rows[row].instructions for row in same.pop("row")]
        assert all(np.array_equal(one[name], same[name]) for name in one)
        start += len(part)


def test_errors_are_told_by_dataset_and_sentence(two: list[Path], cache: Path, tmp_path: Path):
    train(several(two, cache), tmp_path, quiet=True)
    found = errors(tmp_path)
    assert found and set(found) <= {"/".join(path.parts[-2:]) for path in two}
    for values in found.values():
        assert {"target", "goal", "unseen", "swapped"} <= set(values)
        assert {"before", "after"} & set(values) and all(value > 0 for value in values.values())


def test_poses_of_all_objects_must_be_in_the_export(dataset: Path, cache: Path):
    with pytest.raises(TrainError, match="--labels poses"):
        open_corpus(several([dataset, dataset], cache))


def test_an_unknown_task_is_refused_before_a_plan(tmp_path: Path):
    with pytest.raises(RecipeError, match="no task 'click_bel', but click_bell"):
        app(["many", "--out", str(tmp_path), "--tasks", "click_bel"], standalone_mode=False)


def test_a_run_is_commands_and_its_table_is_of_what_was_evaluated(tmp_path: Path):
    many = Many(tmp_path, ("click_bell", "adjust_bottle"), (0, 1), 2, networks=1, scenes=4)
    first = [str(command) for command, _ in zip(commands(many), range(9), strict=False)]
    builds = [line for line in first if " build " in line]
    assert len(builds) == 4 and sum("randomized" in line for line in builds) == 2
    assert "puma train" in first[-1] and "after_success" in first[-1]
    # levels 0 and 1 by unseen sentences, level 1 in three other ways, one of them on a scene
    assert {name: count for name, count, _ in estimate(many)}["evaluation"] == 2 * (4 * 4 + 1)
    part = replace(many, stages=("evaluation",), conditions=("unseen sentences",))
    assert [(name, count) for name, count, _ in estimate(part)] == [("evaluation", 2 * 2 * 4)]
    rows = [
        {
            **{"key": json.dumps(["a", "b", "c", "d", task, seed]), "policy": "p", "clock": "sim"},
            **{"rules": "strict", "task": task, "embodiment": "aloha", "domain": "clean"},
            **{"category": "interception", "failure": "", "success": seed < wins, "level": 1},
            **{"meeting": 2.5 if seed < 2 else None},
            **{"same_start": True, "sees_truth": False, "alpha": 0.1, "seed": seed, "failed": []},
            **{"route_completion": 1, "manipulation_score": 1, "penalties": []},
        }
        for task, wins in (("click_bell", 3), ("adjust_bottle", 0))
        for seed in range(4)
    ]
    for some in (rows[:4], rows[4:]):
        out = many.evaluation(many.learners[0], "unseen sentences") / some[0]["task"]
        out.mkdir(parents=True)
        (out / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in some))
    bell, bottle, together = table(many).splitlines()[2:]
    assert bell.startswith("| unseen sentences | click_bell | 1 | 2 | 3 of 4 | 75 (")
    assert " 0 of 4 " in bottle
    # scenes of one seed in two tasks are two scenes
    assert together.startswith("| unseen sentences | all tasks | 1 | 4 | 3 of 8 | 38 (14-69)")


def test_twins_differ_in_one_thing_and_are_told_beside_the_first_network(tmp_path: Path):
    """Of two tasks the twin solves two scenes more of one; scenes that only one tried are out."""
    tasks, named = ("click_bell", "adjust_bottle"), ("static", "planned", "no-history")
    many = Many(tmp_path, tasks, (0, 1), 2, networks=1, scenes=4, twins=named)
    builds = [
        command.words for command in commands(replace(many, stages=("data",)))
        if command.words[0] == "build"
    ]  # fmt: skip
    shared, still, planned = (
        [words for words in builds if (tmp_path / folder) in Path(words[-1]).parents]
        for folder in ("clean", "static", "planned")
    )
    assert len(builds) == 3 * 4 and len(shared) == 2 and len(still) == len(planned) == 4
    size = {words[words.index("--levels") + 1 :][:3:2] for words in still}
    assert size == {("0", "4")}
    assert all("planned" in words for words in planned)
    assert not any("planned" in words for words in [*shared, *still])
    assert {name: count for name, count, _ in estimate(many)} == {
        **{"data": 3 * 2 * 2 * 2 * 2, "finder": 4 * 12_000, "policy": 4 * 9_000},
        "evaluation": 2 * (4 * 4 + 1 + 3 * 2 * 4),
    }
    [command] = [
        str(command) for command in commands(replace(many, stages=("networks",)))
        if "memory=false" in str(command)
    ]  # fmt: skip
    assert "no-history" in command and f"{tmp_path}/clean/click_bell" in command

    def evaluated(name: str, task: str, wins: int, seeds: range) -> None:
        learner = next(each for each in many.learners if each.name == name)
        out = many.evaluation(learner, "unseen sentences") / task
        out.mkdir(parents=True)
        rows = [
            {
                **{"key": json.dumps(["a", "b", "c", "d", task, seed]), "policy": name},
                **{"clock": "sim", "rules": "strict", "task": task, "embodiment": "aloha"},
                **{"domain": "clean", "category": "interception", "failure": "", "level": 1},
                **{"success": seed < wins, "meeting": None, "same_start": True},
                **{"sees_truth": False, "alpha": 0.1, "seed": seed, "failed": []},
                **{"route_completion": 1, "manipulation_score": 1, "penalties": []},
            }
            for seed in seeds
        ]
        (out / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))

    for task, first, other in (("click_bell", 1, 3), ("adjust_bottle", 2, 2)):
        evaluated("network_0", task, first, range(4))
        evaluated("static", task, other, range(5))
    [line] = twins(many).splitlines()[2:]
    assert line.startswith("| static | 1 | 8 | 38 | 62 | +25.0 (")
    assert "| 3 of 8 |" in table(many)
