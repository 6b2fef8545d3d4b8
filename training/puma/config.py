"""What is trained, on what, and how: read from YAML, every key with a default, unknown keys
refused."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.data.names import CAMERAS, MOUNTED
from pipeline.data.parsing import SHOWN, bounded
from training.puma.errors import TrainError
from training.puma.model_keys import ConfigPart, ImageSize, Model

_Beta = Annotated[float, Field(ge=0, lt=1)]


class MixtureSource(ConfigPart):
    """One dataset of a mixture."""

    dataset: Path
    """Directory that `domino-data build` made."""
    where: str = ""
    """Which episodes, as in `domino-data annotate --where`."""
    weight: Annotated[float, Field(gt=0)] = 1.0
    """Share of the samples."""
    after_success: float | None = None
    """In place of `data.after_success`."""


class Data(ConfigPart):
    """What is read, and how it is scaled."""

    sources: tuple[MixtureSource, ...] = ()
    """The mixture."""
    cameras: Annotated[tuple[str, ...], Field(min_length=1)] = tuple(
        CAMERAS[name] for name in MOUNTED
    )
    """Images the policy sees; the first one is where the past is looked at."""
    image_size: ImageSize = (224, 224)
    """Height and width of all images at the model."""
    flow_size: ImageSize = (64, 64)
    """Height and width of flow maps: those of the annotation."""
    flow_source: Literal["farneback", "sim"] = "farneback"
    """Which flow annotation. A policy can only compute farneback."""
    normalisation: Literal["min_max", "mean_std", "quantile"] = "min_max"
    """How joints and actions are scaled."""
    grippers: Literal["measured", "binary"] = "measured"
    """What is predicted of grippers: their targets, or 0 and 1 for those below and above one half
    (the published code)."""
    balance: Literal["frames", "tasks"] = "frames"
    """Whether all frames of a dataset are equally likely, or all of its tasks (the published
    code)."""
    floor: Annotated[float, Field(gt=0)] = 0.01
    """Smallest half range or deviation (rad, or of a gripper) that a joint is divided by."""
    validation: Annotated[float, Field(ge=0, le=0.5)] = 0.05
    """Share of physics episodes that is kept for validation."""
    after_success: float | None = None
    """Seconds after the success of the task that are learned; the whole episode by default. Without
    a clock, a policy cannot tell the way home from the way to a target. Negative: the last moments
    before the success are left out, too."""
    cache: Path | None = None
    """Where decoded arrays are kept; $XDG_CACHE_HOME/domino-data/puma by default."""


class Train(ConfigPart):
    """Optimisation."""

    steps: Annotated[int, Field(ge=1)] = 100_000
    batch: Annotated[int, Field(ge=1)] = 64
    """Samples a step over all processes."""
    accumulate: Annotated[int, Field(ge=1)] = 1
    """Parts into which a step's samples are cut."""
    seed: Annotated[int, Field(ge=0)] = 0
    start: Path | None = None
    """A run or checkpoint whose weights and scales a new run begins with, for example to adapt to
    other levels."""
    backbone_rate: Annotated[float, Field(gt=0)] = 1e-5
    head_rate: Annotated[float, Field(gt=0)] = 1e-4
    floor_rate: Annotated[float, Field(ge=0)] = 5e-7
    """Learning rate of the backbone at the end; that of the heads ends at the same share of its
    peak."""
    world_rate: Annotated[float, Field(gt=0)] | None = None
    """Highest learning rate of the world head and of the queries; `head_rate` by default. The
    paper names none, the published code has 1e-5."""
    action_loss: Literal["sum", "mean"] = "sum"
    """The L1 of an action: summed over joints (the paper), or their mean (the published code),
    beside which `world_weight` counts as many times more as there are joints."""
    warmup: Annotated[int, Field(ge=0)] = 5000
    betas: tuple[_Beta, _Beta] = (0.9, 0.95)
    epsilon: Annotated[float, Field(gt=0)] = 1e-8
    weight_decay: Annotated[float, Field(ge=0)] = 1e-8
    clip: Annotated[float, Field(gt=0)] = 1.0
    """Largest norm of the gradient."""
    world_weight: Annotated[float, Field(ge=0)] = 0.05
    """lambda: weight of the world loss."""
    shift: Annotated[int, Field(ge=0, le=32)] = 0
    """Images of a sample are moved by up to so many px, all by the same."""
    disturb: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Before the first touch, measured arm joints are moved off their path by up to about this
    (rad): it teaches the way back. Grippers are shuffled among samples, so that the one that closes
    first does not decide which arm acts."""
    precision: Literal["no", "bf16"] = "bf16"
    """Of the arithmetic; weights that are trained are float32: a step of 1e-5 is lost in bf16."""
    parallel: Literal["ddp", "zero2", "fsdp"] = "ddp"
    """Over several processes (`accelerate launch`): copies of everything, gradients and optimiser
    in shares, or weights, too."""
    checkpointing: bool = True
    """Keep no activations of the backbone; compute them again in the backward pass."""
    save_every: Annotated[int, Field(ge=1)] = 5000
    validate_every: Annotated[int, Field(ge=1)] = 1000
    validation_samples: Annotated[int, Field(ge=1)] = 512
    keep: Annotated[int, Field(ge=1)] = 2
    """Checkpoints that stay."""
    trackers: tuple[Literal["tensorboard", "wandb"], ...] = ()
    """Who is told the rows of the log besides; TensorBoard's files are in the run's directory,
    under `puma/`."""


class Execute(ConfigPart):
    """How a trained policy acts."""

    actions: Annotated[int, Field(ge=1)] = 16
    """Actions of each chunk that are executed before the next one is asked for."""
    still: Annotated[int, Field(ge=1)] | None = None
    """As `actions`, while the target's track is slower than 3 cm/s: the later actions of a chunk
    lead down to a touch, where a new chunk would hover above it. Needs `model.track` with its
    memory."""
    ensemble: Annotated[float, Field(ge=0)] | None = None
    """Average all chunks that cover a moment, weights exp(-m i) with i = 0 for the oldest; needs
    `actions` below the chunk."""
    blend: Annotated[int, Field(ge=0)] = 0
    """Actions over which a new chunk takes over from what was left of the one before."""
    batch: Annotated[int, Field(ge=1, le=256)] = 1
    """Rows of every pass of the network where the policy answers several episodes at once; above 1
    the last bits depend on it."""


class Config(ConfigPart):
    """A training run."""

    name: str = "puma"
    model: Model = Model()
    data: Data = Data()
    train: Train = Train()
    execute: Execute = Execute()

    @model_validator(mode="after")
    def _fits(self) -> "Config":
        for name, count in (("actions", self.execute.actions), ("still", self.execute.still or 1)):
            if count > self.model.chunk:
                raise ValueError(
                    f"execute.{name} {count} is more than model.chunk {self.model.chunk}"
                )
        if self.execute.still is not None and not (self.model.track and self.model.track.memory):
            raise ValueError(
                "execute.still needs the target's velocity: set it to null, or give model.track its"
                " memory"
            )
        if self.execute.ensemble is not None and self.execute.blend:
            raise ValueError("execute.ensemble and execute.blend exclude each other")
        if self.train.batch % self.train.accumulate:
            raise ValueError(
                f"train.batch {self.train.batch} is no multiple of train.accumulate"
                f" {self.train.accumulate}"
            )
        if self.model.track and self.train.parallel != "ddp":
            raise ValueError(
                f"train.parallel {self.train.parallel} trains no finder: set it to ddp, or leave"
                " out model.track"
            )
        return self

    def to_yaml(self) -> str:
        """Every key written out."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)


def parse_config(values: Mapping[str, Any], where: str) -> Config:
    """A configuration from plain values. Raises TrainError naming `where` and the key."""
    try:
        return Config.model_validate(bounded(values))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))[:SHOWN]
        said = (
            "is unknown"
            if first["type"] == "extra_forbidden"
            else first["msg"].removeprefix("Value error, ")
        )
        raise TrainError(
            f"{where}: {key}{': ' if key and said != 'is unknown' else ' ' if key else ''}{said}"
        ) from error
