"""Shards, cache, split, batches and sampler: what is read is what the episodes hold, and what is
missing is named."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.annotate.flow import Colour, bit_stable, colour_flow, farneback, shrink_grey
from pipeline.commands.options import Given
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.frames import decode_frame
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.setup import SETUP_FILE, Setup
from tests.synthetic import episode_path, make_episode
from tests.training.puma.tiny import FRAMES, config_of, export
from training.puma.config import Config, MixtureSource, parse_config
from training.puma.corpus.cache import open_cache
from training.puma.corpus.mixture import open_corpus, setup_of
from training.puma.corpus.sampler import Sampler
from training.puma.corpus.samples import batch_of, mixed_batch
from training.puma.corpus.shards import Shards
from training.puma.corpus.split import SplitFrames, split_episodes
from training.puma.errors import TrainError
from training.puma.measure.checks import replay_check
from training.puma.preprocess import Preprocessing, fit_scale
from training.puma.train import train


def changed(config: Config, part: str, **values: object) -> Config:
    """The configuration with other values in its data, model or train part."""
    return config.model_copy(update={part: getattr(config, part).model_copy(update=values)})


def test_only_the_expert_teaches_in_corrected_episodes(tmp_path: Path):
    paths = [episode_path(tmp_path, slot=slot) for slot in range(2)]
    for slot, (path, corrected) in enumerate(zip(paths, (5, 0), strict=True)):
        make_episode(
            path, slot=slot, seed=slot, frames=12, cameras=("head_camera",), corrected=corrected
        )
    export(tmp_path, paths)
    config = config_of(tmp_path, tmp_path / "cache", history="none", world="none")
    config = changed(config, "data", validation=0.0, cameras=("head_camera",))
    corpus = open_corpus(config)
    [part] = corpus.train
    assert (
        part.frame.tolist() == [*range(5, 12), *range(12, 24)]
        and part.episode.tolist() == [0] * 7 + [1] * 12
    )
    # what came before the takeover is still what the policy would have seen
    assert (
        set(part.first[:7]) == {0}
        and set(part.last[:7]) == {11}
        and len(part.cache.arrays["action"]) == 24
    )
    with open_episode(paths[0]) as episode:
        label = episode.array("expert_action")[5:11].astype(np.float32)
    batch = batch_of(part, np.array([0]), config, corpus.preprocessing)
    np.testing.assert_allclose(
        corpus.preprocessing.action.backward(batch["action"][0]), label, atol=1e-5
    )

    # chunks begin at the frames 0, 4 and 8: of the corrected episode only that at 8 is compared,
    # where the expert acts
    train(config, tmp_path / "run", steps=1, quiet=True)
    found = replay_check(tmp_path / "run", None, 2)
    assert found["episodes"] == 2 and found["answers"] == 4 and found["different"] == 0


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(dataset, tmp_path / "bells"))


def test_arrays_are_those_of_the_episodes(dataset: Path, cache: Path):
    config = config_of(dataset, cache)
    found = open_cache(config.data.sources[0], config)
    assert found.length.tolist() == list(FRAMES) and found.start.tolist() == [0, 14, 23]
    with open_episode(episode_path(dataset, slot=1)) as episode:
        rows = slice(14, 23)
        np.testing.assert_array_equal(
            found.arrays["state"][rows], episode.array("joint_state/vector").astype(np.float32)
        )
        np.testing.assert_array_equal(
            found.arrays["action"][rows], episode.array("joint_action/vector").astype(np.float32)
        )
        np.testing.assert_array_equal(
            found.arrays["position"][rows], episode.array("target/pose")[:, :3].astype(np.float32)
        )
        image = episode.rgb("left_camera", 4)
        assert found.source_sizes == {"head_camera": (240, 320), "left_camera": (240, 320)}
    small = found.arrays["image_left_camera"][14 + 4]
    # area average of blocks of 7.5 x 5 px: twice the height is a whole number of rows
    blocks = np.repeat(image, 2, 0).reshape(32, 15, 64, 5, 3).mean((1, 3))
    assert np.abs(small - blocks).max() <= 1
    assert isinstance(found.arrays["image_left_camera"], np.memmap)


def test_a_cache_is_found_again_and_another_size_is_another_one(dataset: Path, cache: Path):
    config, told = config_of(dataset, cache), list[str]()
    first = open_cache(config.data.sources[0], config)
    assert open_cache(config.data.sources[0], config, told.append).path == first.path and not told
    other = changed(config, "data", image_size=(48, 64))
    assert (
        open_cache(config.data.sources[0], other, told.append).path != first.path and len(told) == 1
    )


def test_tasks_are_drawn_equally_where_they_are_balanced(tmp_path: Path):
    paths = [episode_path(tmp_path, task=task) for task in ("click_bell", "shake_bottle")]
    for path, frames in zip(paths, (6, 24), strict=True):
        task = path.relative_to(tmp_path / "episodes").parts[0]
        make_episode(path, task=task, frames=frames, cameras=("head_camera",))
    export(tmp_path, paths)
    config = config_of(tmp_path, tmp_path / "cache", history="none", world="none")
    config = changed(config, "data", validation=0.0, cameras=("head_camera",), balance="tasks")
    corpus = open_corpus(config)
    assert [len(part) for part in corpus.train] == [6, 24] and corpus.weights == [0.5, 0.5]
    corpus = open_corpus(changed(config, "data", balance="frames"))
    assert [len(part) for part in corpus.train] == [30] and corpus.weights == [1.0]


def test_grippers_can_be_binary(dataset: Path, cache: Path):
    config = changed(config_of(dataset, cache), "data", validation=0.0, grippers="binary")
    corpus = open_corpus(config)
    batch = batch_of(corpus.train[0], np.arange(14), config, corpus.preprocessing)
    actions = corpus.preprocessing.action.backward(batch["action"])[:, 0]
    recorded = corpus.train[0].cache.arrays["action"][:14]
    grippers = [name.endswith("gripper") for name in corpus.preprocessing.names]
    np.testing.assert_allclose(actions[:, grippers], recorded[:, grippers] > 0.5, atol=1e-6)
    np.testing.assert_allclose(
        actions[:, ~np.array(grippers)], recorded[:, ~np.array(grippers)], atol=1e-5
    )


def test_chunks_and_history_end_at_the_episode(dataset: Path, cache: Path):
    config = config_of(dataset, cache)
    corpus = open_corpus(changed(config, "data", validation=0.0))
    part = corpus.train[0]
    # the first frame, one in the middle, the last but one, the last of the second episode
    places = np.array([14, 18, 21, 22])
    batch = batch_of(part, places, config, corpus.preprocessing)
    assert batch["action_valid"].tolist() == [
        [True] * 6,
        [True] * 4 + [False] * 2,
        [True] + [False] * 5,
        [False] * 6,
    ]
    actions = part.cache.arrays["action"]
    np.testing.assert_allclose(
        corpus.preprocessing.action.backward(batch["action"][0]), actions[14:20], atol=1e-5
    )
    np.testing.assert_allclose(
        corpus.preprocessing.action.backward(batch["action"][3]), actions[[22] * 6], atol=1e-5
    )
    np.testing.assert_allclose(
        batch["past_time"], [[0, 0], [-2 / 15, 0], [-2 / 15, 0], [-2 / 15, 0]], atol=1e-6
    )
    np.testing.assert_array_equal(batch["past"][1], part.cache.arrays["past"][[16, 18]])
    np.testing.assert_array_equal(batch["past"][0], part.cache.arrays["past"][[14, 14]])
    # the world two and four frames later: past the last frame (22) nothing is asked for
    assert batch["world_valid"].tolist() == [
        [True, True],
        [True, True],
        [False, False],
        [False, False],
    ]
    np.testing.assert_array_equal(
        batch["world"][1], part.cache.arrays["world"][[20, 22]].astype(np.float32)
    )
    np.testing.assert_allclose(batch["clock"], np.array([0, 4, 7, 8]) / 15, atol=1e-6)
    assert batch["row"].tolist() == [1, 1, 1, 1]


def test_a_target_that_is_not_seen_is_not_asked_for(copy: Path, cache: Path):
    config = config_of(copy, cache, world="boxes")
    [path] = copy.glob("annotations/masks@*/click_bell/aloha-agilex/L1/clean/episode_0000000.h5")
    from pipeline.annotate.store import read_entry, write_entry

    entry = read_entry(path)
    arrays = {name: np.array(values) for name, values in entry.arrays.items()}
    arrays["valid"][4] = False
    write_entry(path, entry.key, arrays, entry.attributes)
    corpus = open_corpus(changed(config, "data", validation=0.0))
    batch = batch_of(corpus.train[0], np.array([2, 0]), config, corpus.preprocessing)
    assert batch["world_valid"].tolist() == [[False, True], [True, False]]
    box = arrays["box"][2, 0] / [320, 240, 320, 240]
    np.testing.assert_allclose(batch["world"][1, 0], box, atol=1e-3)


@pytest.mark.parametrize("scale", ["per_map", "fixed"])
def test_a_policy_makes_the_flow_maps_of_training(dataset: Path, cache: Path, scale: str):
    config = config_of(dataset, cache, flow_scale=scale)
    corpus = open_corpus(config)
    with open_episode(episode_path(dataset, slot=2)) as episode:
        images = [decode_frame(episode.jpeg("head_camera", t)) for t in range(FRAMES[2])]
    prep, cached = corpus.preprocessing, corpus.train[0].cache.arrays["past"]
    glances = [prep.glance(images[t]) for t in (5, 7, 9)]
    np.testing.assert_array_equal(prep.past(glances), cached[[23 + 7, 23 + 9]])
    still = prep.glance(images[0])
    np.testing.assert_array_equal(prep.past([still, still, still]), cached[[23, 23]])
    # and both are what the annotation's own functions give
    with bit_stable():
        flow = farneback(
            shrink_grey(images[7], (32, 32)), shrink_grey(images[9], (32, 32)), prep.farneback
        )
    wanted, _ = colour_flow(flow[None].astype(np.float16), Colour(normalisation=scale))
    np.testing.assert_array_equal(prep.past(glances)[1], wanted[0])
    assert prep.past(glances).max() > 50


def test_scales_have_a_floor():
    values = np.array([[0.0, 1.0, 5.0], [1.0, 1.0, 5.002], [0.5, 1.0, 5.001]])
    scale = fit_scale(values, ("moves", "still", "noise"), "min_max", 0.01)
    assert scale.constant == ("still", "noise")
    np.testing.assert_allclose(
        scale.forward(values), [[-1, 0, -0.1], [1, 0, 0.1], [0, 0, 0]], atol=1e-4
    )
    np.testing.assert_allclose(scale.backward(scale.forward(values)), values, atol=1e-6)
    deviations = fit_scale(values, ("moves", "still", "noise"), "mean_std", 0.01).forward(values)
    assert deviations[:, 0].std() == pytest.approx(1, abs=1e-5)
    wide = np.append(np.linspace(0, 1, 999), 1000.0)[:, None]
    assert abs(fit_scale(wide, ("one",), "quantile", 0.01).spread[0] - 0.49) < 0.01


def test_preprocessing_comes_back_from_json(dataset: Path, cache: Path):
    prep = open_corpus(config_of(dataset, cache)).preprocessing
    again = Preprocessing.from_dict(prep.to_dict())
    assert again == prep and again.digest == prep.digest
    assert dataclasses.replace(prep, stride=3).digest != prep.digest
    with pytest.raises(TrainError, match="of another version"):
        Preprocessing.from_dict(prep.to_dict() | {"more": 1})


def test_the_split_is_by_physics_episode(dataset: Path, cache: Path):
    config = config_of(dataset, cache)
    found = open_cache(config.data.sources[0], config)
    looks = [
        dataclasses.replace(row, physics_id=f"physics {i // 2}")
        for i, row in enumerate(found.rows * 200)
    ]
    many = dataclasses.replace(found, rows=looks)
    train, held = split_episodes(many, 0.2)
    assert {looks[i].physics_id for i in train}.isdisjoint({looks[i].physics_id for i in held})
    assert len(train) + len(held) == 600 and 60 <= len(held) <= 180
    # more episodes move none from one side to the other
    fewer, _ = split_episodes(dataclasses.replace(found, rows=looks[:300]), 0.2)
    assert set(fewer) == {i for i in train if i < 300}


def test_a_mixture_takes_its_sources_by_weight_and_keeps_rows_together(dataset: Path, cache: Path):
    config = config_of(dataset, cache)
    corpus = open_corpus(changed(config, "data", validation=0.0))
    part = corpus.train[0]
    other = SplitFrames.of(part.cache, [1])
    sources, places = np.array([1, 0, 1, 0]), np.array([3, 30, 0, 2])
    batch, texts = mixed_batch([part, other], (sources, places), config, corpus.preprocessing)
    np.testing.assert_array_equal(
        batch["image_head_camera"], part.cache.arrays["image_head_camera"][[17, 30, 14, 2]]
    )
    assert batch["row"].tolist() == [1, 2, 1, 0]
    for text, row in zip(texts, batch["row"], strict=True):
        assert text in part.cache.rows[row].instructions
    drawn = np.bincount(
        np.concatenate([s for s, _ in (Sampler([9, 5], [3, 1], 4000, 0).next() for _ in range(1))]),
        minlength=2,
    )
    assert abs(drawn[0] / 4000 - 0.75) < 0.03


def test_the_sampler_goes_on_where_it_stopped_and_visits_every_frame():
    whole, part = Sampler([7, 5], [1, 1], 4, seed=3), Sampler([7, 5], [1, 1], 4, seed=3)
    expected = [whole.next() for _ in range(12)]
    for _ in range(5):
        part.next()
    other = Sampler([7, 5], [1, 1], 4, seed=3)
    other.load(part.state())
    for wanted in expected[5:]:
        for a, b in zip(other.next(), wanted, strict=True):
            np.testing.assert_array_equal(a, b)
    for source, size in ((0, 7), (1, 5)):
        order = [
            int(p) for s, places in expected for k, p in zip(s, places, strict=True) if k == source
        ]
        assert sorted(order[:size]) == list(range(size)) and sorted(order[size : 2 * size]) == list(
            range(size)
        )
        assert order[:size] != order[size : 2 * size]
    with pytest.raises(ValueError, match="not that of the checkpoint"):
        Sampler([7, 6], [1, 1], 4, seed=3).load(part.state())


def fails(config: Config) -> str:
    with pytest.raises(TrainError) as caught:
        open_corpus(config)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_missing_is_named_with_its_command(copy: Path, tmp_path: Path):
    config = config_of(copy, tmp_path / "cache")
    head = f"domino-data annotate {copy}"
    flow = (
        f"run: {head} --stages flow --cameras head_camera --flow-stride 3 --flow-size 32x32"
        " --flow-source farneback"
    )
    assert fails(changed(config, "model", stride=3)).endswith(flow)
    shutil.rmtree(next(copy.glob("annotations/features@*")))
    assert fails(config).endswith(f"run: {head} --stages masks,features --cameras head_camera")
    shutil.rmtree(next(copy.glob("annotations/masks@*")))
    boxes = config_of(copy, tmp_path / "cache", world="boxes")
    assert fails(boxes).endswith(
        f"run: {head} --stages masks --cameras head_camera --mask-source sim"
    )
    one = config_of(copy, tmp_path / "cache", world="none")
    next(copy.glob("annotations/flow@*/click_bell/*/*/*/episode_0000001.h5")).unlink()
    assert "is missing or damaged; run: domino-data annotate" in fails(one)
    shutil.rmtree(copy / "exports")
    assert fails(one).endswith(f"run: domino-data export {copy} --format parquet")
    assert "data.sources is empty" in fails(changed(one, "data", sources=()))


def test_annotations_of_other_images_are_refused(copy: Path, tmp_path: Path):
    path = next(copy.glob("annotations/flow@*/click_bell/*/*/*/episode_0000000.h5"))
    shutil.copy(path.with_name("episode_0000002.h5"), path)
    assert "was made from other images; run: domino-data annotate" in fails(
        config_of(copy, tmp_path / "cache", world="none")
    )


def test_an_export_without_every_episode_is_stale(copy: Path, tmp_path: Path, dataset: Path):
    from pipeline.data.keys import Key, SlotKeys
    from pipeline.data.recipe.model import parse_recipe
    from tests.recording import finish

    recipe, parts = (
        parse_recipe({"tasks": "click_bell", "levels": 1, "episodes": 4}),
        SlotKeys(Key({"a": "b"}), Key({}), Key({})),
    )
    (copy / "manifest.yaml").write_text(recipe.to_yaml())
    for slot in recipe.slots():
        finish(Dataset(copy), slot, parts, [{"attempt": 0, "seed": 0, "outcome": "accepted"}])
    found = fails(config_of(copy, tmp_path / "cache"))
    assert "is stale: it has 3 episodes, the dataset 4" in found and found.endswith(
        "--format parquet"
    )


def test_an_episode_may_be_cut_into_row_groups(copy: Path, tmp_path: Path):
    config = config_of(copy, tmp_path / "cache")
    whole = [
        Shards(config.data.sources[0], config).read(row)
        for row in Shards(config.data.sources[0], config).rows
    ]
    path = copy / "exports" / "parquet" / "data-00000.parquet"
    table = pq.read_table(path)
    with pq.ParquetWriter(path, table.schema) as writer:
        for start, rows in ((0, 10), (10, 4), (14, 9), (23, 8), (31, 6)):
            writer.write_table(table.slice(start, rows))
    shards = Shards(config.data.sources[0], config)
    for row, wanted in zip(shards.rows, whole, strict=True):
        np.testing.assert_array_equal(shards.read(row).state, wanted.state)
        assert shards.read(row).images == wanted.images


def test_what_comes_after_the_success_can_be_left_out(copy: Path, tmp_path: Path):
    config = config_of(copy, tmp_path / "cache")
    whole = open_cache(config.data.sources[0], config)
    path = copy / "exports" / "parquet" / "episodes.parquet"
    table = pq.read_table(path)
    success = pa.array([3 / whole.fps, None, 12.5 / whole.fps], pa.float64())
    pq.write_table(
        table.set_column(table.schema.get_field_index("t_success"), "t_success", success), path
    )
    sooner = changed(config, "data", after_success=-2 / whole.fps)
    assert open_cache(config.data.sources[0], sooner).length.tolist() == [2, FRAMES[1], 11]
    config = changed(config, "data", after_success=2 / whole.fps)
    found = open_cache(config.data.sources[0], config)
    assert found.length.tolist() == [6, FRAMES[1], FRAMES[2]]
    kept = np.r_[:6, FRAMES[0] : sum(FRAMES)]
    for name, values in whole.arrays.items():
        np.testing.assert_array_equal(found.arrays[name], values[kept])


def test_where_chooses_episodes(dataset: Path, cache: Path):
    config = config_of(dataset, cache)
    rows = Shards(MixtureSource(dataset=dataset, where="slot in (0, 2)"), config).rows
    assert [row.index for row in rows] == [0, 2]
    with pytest.raises(TrainError, match="no episode fits where: 'level=3'"):
        Shards(MixtureSource(dataset=dataset, where="level=3"), config)


def test_a_policy_is_made_for_the_setup_of_its_data(tmp_path):
    own = {"name": "own", "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48, "fovy": 60.0}
    recipe = {
        "tasks": "click_bell",
        "fps": 30,
        "layout": "original",
        "depth": True,
        "cameras": ["head", "left", own],
    }
    Dataset(tmp_path / "set").create(parse_recipe(recipe))
    config = parse_config(
        {
            "data": {
                "sources": [{"dataset": str(tmp_path / "set")}],
                "cameras": ["head_camera", "own"],
            }
        },
        "test",
    )
    found = setup_of(config)
    assert (found["fps"], found["layout"], found["cameras"][0]) == (30, "original", "head")
    assert found.keys() == {"fps", "layout", "cameras"} and Setup.parse(found).camera_names == (
        "head_camera",
        "own",
    )
    assert setup_of(parse_config({}, "test")) == {}
    (tmp_path / SETUP_FILE).write_text(yaml.safe_dump(found))
    again = Given(like=tmp_path, values={"tasks": ["click_bell"], "fps": 15}).recipe(levels=[1])
    assert (again.fps, again.levels, again.setup.given()) == (
        15,
        (1,),
        {k: v for k, v in found.items() if k != "fps"},
    )


def test_an_oracle_is_replayed_on_the_recorded_future(dataset: Path, cache: Path, tmp_path: Path):
    config = config_of(dataset, cache, oracle=True)
    train(changed(config, "data", validation=0.0), tmp_path / "run", steps=1, quiet=True)
    found = replay_check(tmp_path / "run", None, 2)
    assert found["answers"] > 0 and found["different"] == 0
