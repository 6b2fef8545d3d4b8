"""Configurations: all that come with the package are valid, unknown keys are refused, settings and
files come on top."""

from pathlib import Path

import pytest

from training.puma.config import Config, parse_config, yaml
from training.puma.errors import TrainError
from training.puma.options import configuration
from training.puma.reading import CONFIGS, names, read_config


@pytest.mark.parametrize("name", names())
def test_every_configuration_is_valid_and_named_like_its_file(name: str):
    config = read_config(name)
    assert config.name == name
    assert (CONFIGS / f"{name}.yaml").read_text().startswith("# ")
    assert parse_config(yaml.safe_load(config.to_yaml()), name) == config


def test_the_papers_values():
    config = read_config("puma-4b")
    model, train = config.model, config.train
    assert (
        model.chunk,
        model.world_queries,
        model.history_length,
        model.stride,
        train.world_weight,
    ) == (16, 4, 4, 4, 0.05)
    assert (
        train.backbone_rate,
        train.head_rate,
        train.betas,
        train.epsilon,
        train.weight_decay,
    ) == (1e-5, 1e-4, (0.9, 0.95), 1e-8, 1e-8)
    assert (train.warmup, train.floor_rate, train.steps, train.clip) == (5000, 5e-7, 100_000, 1.0)


def refused(values: dict, *settings: str) -> str:
    with pytest.raises(TrainError) as caught:
        parse_config(values, "file.yaml") if not settings else read_config("puma-tiny", settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_unknown_keys_and_wrong_values_are_refused():
    assert refused({"model": {"chunks": 3}}) == "file.yaml: model.chunks is unknown"
    assert refused({"model": {"chunk": 0}}).startswith(
        "file.yaml: model.chunk: Input should be greater than or equal to 1"
    )
    assert (
        refused({"execute": {"actions": 17}})
        == "file.yaml: execute.actions 17 is more than model.chunk 16"
    )
    blind = refused({"execute": {"still": 8}, "model": {"track": {"memory": False}}})
    wanted = (
        "file.yaml: execute.still needs the target's velocity: set it to null, or give model.track"
        " its memory"
    )
    assert blind == refused({"execute": {"still": 8}}) == wanted
    assert "no multiple of train.accumulate" in refused({"train": {"batch": 5, "accumulate": 2}})
    assert "exclude each other" in refused({"execute": {"ensemble": 0.1, "blend": 2}})
    assert "train.betas.1: Input should be less than 1" in refused({"train": {"betas": [0.9, 2]}})
    assert "train.clip: Input should be a finite number" in refused(
        {"train": {"clip": float("nan")}}
    )
    assert "data.cameras: Tuple should have at least 1 item" in refused({"data": {"cameras": []}})
    assert "model.backbone: width 128 is no multiple of heads 7" in refused(
        {"model": {"backbone": {"kind": "tiny", "heads": 7}}}
    )
    blind = {"kind": "perceptron"}
    assert "a perceptron reads no images: set model.track" in refused(
        {"model": {"backbone": blind}}
    )
    assert "set model.world to none" in refused({"model": {"backbone": blind, "track": {}}})
    assert "set model.track" in refused({"model": {"arms": True}})
    assert refused({}, "train.stepz=3") == "puma-tiny: train.stepz is unknown"
    assert (
        refused({}, "train.steps")
        == "--set 'train.steps': write key=value, for example train.steps=1000"
    )
    with pytest.raises(
        TrainError, match="--config 'nothing' is unknown: give a YAML file or one of puma-2b, "
    ):
        read_config("nothing")


def test_a_file_stands_on_another_one(tmp_path: Path):
    (tmp_path / "base.yaml").write_text("name: base\nmodel: {chunk: 20, state: true}\n")
    (tmp_path / "mine.yaml").write_text("extends: base\nname: mine\nmodel: {chunk: 24}\n")
    config = read_config(str(tmp_path / "mine.yaml"), ["train.steps=7", "execute.actions=3"])
    assert (
        config.name,
        config.model.chunk,
        config.model.state,
        config.train.steps,
        config.execute.actions,
    ) == ("mine", 24, True, 7, 3)
    (tmp_path / "base.yaml").write_text("extends: mine\n")
    with pytest.raises(TrainError, match="extends itself"):
        read_config(str(tmp_path / "mine.yaml"))
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(TrainError, match="is not a mapping"):
        read_config(str(tmp_path / "list.yaml"))


def test_queries_are_counted():
    assert Config().model.queries == 20
    assert read_config("puma-4b-no-auxiliary").model.queries == 16


def test_a_dataset_is_named_for_every_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (source,) = configuration("puma-tiny", None, [Path("out/bells")]).data.sources
    assert source.dataset == tmp_path / "out" / "bells"


def test_no_is_a_precision_although_yaml_reads_it_as_false():
    assert read_config("puma-tiny", ["train.precision=no"]).train.precision == "no"
