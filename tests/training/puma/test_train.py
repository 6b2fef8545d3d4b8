"""A run from training to the closed loop: it goes on bit by bit where it stopped, and its
checkpoint acts by itself."""

import json
import shutil
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pipeline.data.episode.file import open_episode
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.contract import mismatch
from pipeline.evaluate.policies.policy import Observation, PolicyError, Start
from tests.synthetic import episode_path, vector_names
from tests.training.puma.tiny import config_of, qwen_json
from training.puma import checkpoint
from training.puma.config import Config, Execute, MixtureSource
from training.puma.corpus.cache import Cache, open_cache
from training.puma.corpus.mixture import Corpus, open_corpus
from training.puma.corpus.samples import batch_of
from training.puma.corpus.split import SplitFrames
from training.puma.errors import TrainError
from training.puma.loop.loader import LOADING
from training.puma.loop.rates import groups, rate_at
from training.puma.loop.runs import LOG
from training.puma.loop.validation import open_loop
from training.puma.measure.checks import overfit, replay_check
from training.puma.model.inputs import inputs_of
from training.puma.model.puma import Sizes, build_model
from training.puma.policy import Memory, PumaPolicy
from training.puma.train import train

SIZES = {"head_camera": (240, 320), "left_camera": (240, 320)}


def with_train(config: Config, **values: object) -> Config:
    return config.model_copy(update={"train": config.train.model_copy(update=values)})


@pytest.fixture(scope="module")
def run(dataset: Path, cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of six steps."""
    out = tmp_path_factory.mktemp("run")
    train(config_of(dataset, cache, clock=True), out, quiet=True)
    return out


def losses(out: Path) -> list[float]:
    return [json.loads(line)["loss"] for line in (out / LOG).read_text().splitlines()]


@pytest.mark.parametrize("kind", ["tiny", "qwen3-vl"])
def test_a_run_that_was_stopped_goes_on_to_the_same_bits(
    dataset: Path, cache: Path, tmp_path: Path, kind: str
):
    model = {}
    if kind == "qwen3-vl":
        lora = {"rank": 2, "dropout": 0.5}
        model = {
            "backbone": {
                "kind": kind,
                "name": str(qwen_json(tmp_path / "q.json")),
                "weights": "random",
                "lora": lora,
            }
        }
    config = with_train(config_of(dataset, cache, **model), shift=2, validate_every=100)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    train(config, whole, quiet=True)
    train(config, parts, steps=2, quiet=True)
    torch.rand(7)  # another state of the generator than at the stop
    train(config, parts, quiet=True)
    assert losses(whole) == losses(parts) and len(losses(whole)) == 6
    ends = [load_file(checkpoint.newest(out) / "model.safetensors") for out in (whole, parts)]
    assert all(torch.equal(value, ends[1][name]) for name, value in ends[0].items())


def test_steps_that_a_killed_run_logged_are_logged_once(
    run: Path, dataset: Path, cache: Path, tmp_path: Path
):
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    wanted = (copy / LOG).read_bytes()
    shutil.rmtree(checkpoint.newest(copy))
    with (copy / LOG).open("ab") as file:
        file.write(b'{"step": 7, "lo')
    train(config_of(dataset, cache, clock=True), copy, quiet=True)
    assert (copy / LOG).read_bytes() == wanted


def test_a_refused_run_leaves_nothing_and_what_was_never_trained_may_change(
    dataset: Path, cache: Path, tmp_path: Path
):
    config = with_train(config_of(dataset, cache), steps=1)
    missing = config.model_copy(
        update={"data": config.data.model_copy(update={"cameras": ("nose",)})}
    )
    with pytest.raises(
        TrainError, match=r"has no images of nose; data.cameras can be head_camera, left_camera$"
    ):
        train(missing, tmp_path / "run", quiet=True)
    nowhere = config.model_copy(
        update={
            "data": config.data.model_copy(
                update={"sources": (MixtureSource(dataset=tmp_path / "no"),)}
            )
        }
    )
    with pytest.raises(
        TrainError, match=r"no does not exist: give --data the directory of a dataset$"
    ):
        train(nowhere, tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.yaml").write_text(missing.to_yaml())
    train(config, tmp_path / "run", quiet=True)
    assert checkpoint.load(tmp_path / "run").step == 1


def test_a_mixture_is_replayed_where_only_one_part_is_validated(
    dataset: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def split(found: Cache, share: float) -> tuple[list[int], list[int]]:
        return ([0], [1]) if len(found.rows) == 2 else ([0], [])

    monkeypatch.setattr("training.puma.corpus.mixture.split_episodes", split)
    sources = tuple(
        MixtureSource(dataset=dataset, where=where) for where in ("slot=2", "slot in (0, 1)")
    )
    config = config_of(dataset, cache)
    config = config.model_copy(update={"data": config.data.model_copy(update={"sources": sources})})
    train(config, tmp_path / "run", steps=1, quiet=True)
    assert not any(thread.name == LOADING for thread in threading.enumerate())
    found = replay_check(tmp_path / "run", None, 3)
    # the second of three episodes has 9 frames: chunks are asked for at 0 and 4
    assert found["episodes"] == 1 and found["answers"] == 2 and found["different"] == 0


def test_a_checkpoint_says_how_it_was_made_and_holds_no_pickle(run: Path):
    held = checkpoint.load(run)
    assert held.step == 6 and held.path.name == "step_00000006"
    assert len(checkpoint.checkpoints(run)) == 2
    files = {path.name for path in held.path.iterdir()}
    texts = {"state.json", "config.yaml", "preprocessing.json", "policy.py", "README.md"}
    assert files == texts | {"model.safetensors", "optimizer.safetensors"}
    card = (held.path / "README.md").read_text()
    assert (
        "step 6" in card
        and held.preprocessing.digest in card
        and "head_camera, left_camera" in card
    )
    rows = [json.loads(line) for line in (run / LOG).read_text().splitlines()]
    assert [row["step"] for row in rows] == [1, 2, 3, 4, 5, 6]


def test_validation_is_the_open_loop_error(run: Path, dataset: Path, cache: Path):
    held = checkpoint.load(run)
    network = held.model()
    corpus = open_corpus(held.config)
    corpus = Corpus(
        held.config,
        corpus.train,
        [SplitFrames.of(corpus.train[0].cache, [1])],
        held.preprocessing,
        [1.0],
    )
    found = open_loop(network, corpus, "cpu")
    arrays = batch_of(corpus.validation[0], np.arange(9), held.config, held.preprocessing)
    with torch.inference_mode():
        outputs = network(inputs_of(arrays, [""] * 9, held.config, network.words)).actions.numpy()
    wrong = np.abs(outputs - arrays["action"]) * held.preprocessing.action.spread
    # the instruction is another one here, which changes little
    assert found["error"] == pytest.approx(wrong[arrays["action_valid"]].mean(), rel=0.1)
    assert network.training


def test_a_changed_preprocessing_or_configuration_is_refused(
    run: Path, dataset: Path, cache: Path, tmp_path: Path
):
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    other = with_train(config_of(dataset, cache, clock=True), seed=5)
    with pytest.raises(
        TrainError, match=r"holds a run of another configuration \(train.seed 0, now 5\)"
    ):
        train(other, copy, quiet=True)
    path = checkpoint.newest(copy) / "preprocessing.json"
    path.write_text(path.read_text().replace('"stride": 2', '"stride": 3'))
    with pytest.raises(TrainError, match="not the one that the weights were trained with"):
        checkpoint.load(copy)
    with pytest.raises(TrainError, match=r"holds no checkpoint: name a directory"):
        checkpoint.load(tmp_path / "nothing")


def test_accumulated_parts_are_one_batch(dataset: Path, cache: Path, tmp_path: Path):
    found = []
    for parts in (1, 2):
        config = with_train(
            config_of(dataset, cache, world="none"), accumulate=parts, validate_every=100
        )
        found.append(train(config, tmp_path / str(parts), steps=2, quiet=True).rows[-1]["norm"])
    # a part's mean runs over its own valid steps, so the two agree only nearly
    assert found[0] == pytest.approx(found[1], rel=0.2)


def test_learning_rates(dataset: Path, cache: Path):
    settings = config_of(dataset, cache).train.model_copy(
        update={"warmup": 10, "steps": 110, "floor_rate": 1e-4}
    )
    assert [round(rate_at(step, settings), 4) for step in (0, 4, 9, 10, 60, 110, 500)] == [
        0.1,
        0.5,
        1,
        1,
        0.55,
        0.1,
        0.1,
    ]
    config = config_of(dataset, cache)
    network = build_model(config, Sizes(14, 32))
    rates = {"backbone_rate": 1e-5, "head_rate": 1e-4, "weight_decay": 0.1}
    for world in (None, 3e-5):
        found = groups(network, config.train.model_copy(update=rates | {"world_rate": world}))
        rate = {id(weight): group["lr"] for group in found for weight in group["params"]}
        decay = {id(weight): group["weight_decay"] for group in found for weight in group["params"]}
        assert len(rate) == len(list(network.parameters()))
        for name, weight in network.named_parameters():
            expected = 1e-5 if name.startswith("backbone.") else 1e-4
            if name.startswith(("queries", "world_head.")):
                expected = world or 1e-4
            assert rate[id(weight)] == expected
            assert decay[id(weight)] == (0.1 if weight.ndim > 1 and name != "queries" else 0)


def test_one_batch_is_learned_by_heart(dataset: Path, cache: Path):
    found = overfit(with_train(config_of(dataset, cache), backbone_rate=3e-3, head_rate=3e-3), 150)
    assert found["last"] < 0.1 * found["first"]


def start(names: tuple[str, ...] = vector_names("aloha-agilex")) -> Start:
    return Start("press the bell", "aloha-agilex", names, 15, tuple(SIZES), 0, SIZES)


def seen(time: float, episode: int = 0) -> Observation:
    rng = np.random.default_rng(round(time * 15) + 1000 * episode)
    images = {
        camera: rng.integers(0, 256, (*size, 3), dtype=np.uint8) for camera, size in SIZES.items()
    }
    return Observation(rng.normal(size=14), "press the bell", time, images)


def test_a_policy_is_shown_what_it_was_trained_on(run: Path):
    found = replay_check(run, None, 3)
    assert found["different"] == 0 and found["answers"] >= 3 and found["episodes"] >= 1
    assert len(found["errors"]) == 14 and 0 < found["error"] < 2


def test_the_file_of_a_checkpoint_is_a_policy(run: Path):
    path = checkpoint.newest(run) / "policy.py"
    policy = make_policy(policy_name(str(path)))
    contract = policy.contract  # pyright: ignore[reportAttributeAccessIssue]
    assert mismatch(contract, start()) == ""
    assert "image size of head_camera" in mismatch(
        contract, Start("", "", contract.action_names, 15, (), 0, {**SIZES, "head_camera": (1, 1)})
    )
    policy.reset(start())
    first = policy.act(seen(0.0))
    # answers come as often as the history needs an image: every two periods, of four that are
    # executed
    assert np.shape(first) == (2, 14) and np.isfinite(first).all()
    policy.reset(start())
    np.testing.assert_array_equal(policy.act(seen(0.0)), first)
    with pytest.raises(
        PolicyError, match="robot: the policy has aloha-agilex, the evaluation piper"
    ):
        policy.reset(replace(start(), embodiment="piper"))


class Numbered(PumaPolicy):
    """A policy whose n-th chunk is n + 0.01 k at its k-th step."""

    count = 0

    def plan_together(self, asked: Sequence[tuple[Memory, Observation]]) -> list[np.ndarray]:
        self.count += len(asked)
        return [np.repeat((self.count + 0.01 * np.arange(6))[:, None], 14, 1) for _ in asked]


def played(run: Path, **execute: object) -> list[float]:
    held = checkpoint.load(run)
    policy = Numbered(held.model(), held.preprocessing, Execute(**execute))
    policy.reset(start())
    out: list[float] = []
    while len(out) < 8:
        out += policy.act(seen(len(out) / 15))[:, 0].tolist()
    return out


def test_chunks_are_executed_blended_and_averaged(run: Path):
    assert played(run, actions=4) == pytest.approx([1, 1.01, 1.02, 1.03, 2, 2.01, 2.02, 2.03])
    # over two steps the new chunk (2.00, 2.01) takes over from the rest of the old one (1.04, 1.05)
    blended = [1, 1.01, 1.02, 1.03, (2 * 1.04 + 2.0) / 3, (1.05 + 2 * 2.01) / 3, 2.02, 2.03]
    assert played(run, actions=4, blend=2) == pytest.approx(blended)
    halves = played(run, actions=2, ensemble=0.0)
    assert halves[:4] == pytest.approx([1, 1.01, (1.02 + 2) / 2, (1.03 + 2.01) / 2])
    assert halves[4] == pytest.approx((1.04 + 2.02 + 3) / 3)


@pytest.mark.parametrize("batch", [1, 3])
def test_episodes_that_are_answered_together_get_the_answers_of_each_alone(run: Path, batch: int):
    held = checkpoint.load(run)
    execute = held.config.execute.model_copy(update={"batch": batch})
    policy = PumaPolicy(held.model(), held.preprocessing, execute)
    words = ("press", "press " * 40, "press the bell", "push", "press")
    times = np.arange(0, 8, policy.period) / 15
    alone = []
    for n, text in enumerate(words):
        policy.reset(start())
        alone.append([policy.act(replace(seen(t, n), instruction=text)) for t in times])
    episodes = [policy.begin(start()) for _ in words]
    for k, t in enumerate(times):
        # in another order, and in other company, at every question
        order = np.random.default_rng(k).permutation(len(words))
        for group in (order[: k + 1], order[k + 1 :]):
            asked = [(episodes[n], replace(seen(t, n), instruction=words[n])) for n in group]
            for n, answer in zip(group, policy.act_together(asked), strict=True):
                # one row a pass gives the same bits; among more rows the place of a row decides how
                # it is rounded
                np.testing.assert_allclose(
                    answer, alone[n][k], rtol=0, atol=0 if batch == 1 else 1e-5
                )
    assert [episode.inferences for episode in episodes] == [2] * len(words)


def test_history_is_by_simulated_time(run: Path):
    held = checkpoint.load(run)
    policy = PumaPolicy(held.model(), held.preprocessing)
    policy.reset(start())
    frames = [seen(k / 15) for k in range(0, 10, 2)]
    for observation in frames:
        policy.act(observation)
    glances = [held.preprocessing.glance(f.images["head_camera"]) for f in frames[-3:]]
    arrays = policy.given(frames[-1])
    np.testing.assert_array_equal(arrays["past"][0], held.preprocessing.past(glances))
    np.testing.assert_allclose(arrays["past_time"], [[-2 / 15, 0]], atol=1e-6)
    # a world that went on while the policy thought: the newest image that is old enough counts
    late = seen(9 / 15)
    policy.act(late)
    glances = [
        held.preprocessing.glance(f.images["head_camera"]) for f in (frames[2], frames[3], late)
    ]
    np.testing.assert_array_equal(policy.given(late)["past"][0], held.preprocessing.past(glances))


def test_images_of_an_episode_file_reach_the_network_unchanged(
    run: Path, dataset: Path, cache: Path
):
    held = checkpoint.load(run)
    policy = PumaPolicy(held.model(), held.preprocessing)
    policy.reset(start())
    with open_episode(episode_path(dataset, slot=0)) as episode:
        images = {camera: episode.rgb(camera, 0) for camera in SIZES}
        policy.act(Observation(episode.array("joint_state/vector")[0], "press", 0.0, images))
        inputs = policy.inputs(
            Observation(episode.array("joint_state/vector")[0], "press", 0.0, images)
        )
    config = config_of(dataset, cache, clock=True)
    cached = open_cache(config.data.sources[0], config).arrays["image_left_camera"]
    np.testing.assert_array_equal(inputs.views[0, 1].numpy(), cached[0])
    assert inputs.clock is not None and inputs.clock.tolist() == [[0.0]]


def test_adapters_begin_from_a_trained_policy(dataset: Path, cache: Path, tmp_path: Path):
    backbone = {
        "kind": "qwen3-vl",
        "name": str(qwen_json(tmp_path / "q.json")),
        "weights": "random",
    }
    first = with_train(config_of(dataset, cache, backbone=backbone), validate_every=100)
    train(first, tmp_path / "first", steps=1, quiet=True)
    adapted = config_of(dataset, cache, backbone=backbone | {"lora": {"rank": 2}})
    adapted = with_train(adapted, start=tmp_path / "first", validate_every=100)
    train(adapted, tmp_path / "second", steps=2, quiet=True)
    before, after = (
        load_file(checkpoint.newest(tmp_path / n) / "model.safetensors")
        for n in ("first", "second")
    )
    same = [n for n in after if n.startswith("backbone.") and ".lora_" not in n]
    assert all(torch.equal(after[name], before[name.replace(".base_layer", "")]) for name in same)
    assert any(value.any() for name, value in after.items() if "lora_B" in name)
    wider = with_train(config_of(dataset, cache), start=tmp_path / "first")
    with pytest.raises(TrainError, match="weights are of another network"):
        train(wider, tmp_path / "third", quiet=True)
    other = wider.model_copy(
        update={"data": wider.data.model_copy(update={"image_size": (64, 64)})}
    )
    with pytest.raises(TrainError, match="was trained with another image_size"):
        train(other, tmp_path / "fourth", quiet=True)
