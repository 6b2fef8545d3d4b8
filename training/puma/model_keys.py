"""The keys of `model` in a configuration: backbone, inputs, queries and outputs of the network."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from pipeline.data.parsing import LARGEST_NUMBER, show_value

ImageSize = tuple[Annotated[int, Field(ge=16, le=4096)], Annotated[int, Field(ge=16, le=4096)]]


class ConfigPart(BaseModel):
    """Keys of a configuration. Unknown keys are refused, and so are values of another type, such as
    true for a number."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False
    )

    @field_validator("*", mode="before")
    @classmethod
    def _number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML true/false is not accepted where a number is expected, nor a text for a whole
        number, nor 10^30 anywhere."""
        if info.field_name == "precision" and value is False:
            return "no"  # as YAML reads it
        kind = cls.model_fields[str(info.field_name)].annotation
        parts = value if isinstance(value, list | tuple) else [value]
        if kind is not bool and any(isinstance(part, bool) for part in parts):
            raise ValueError("is true or false where a number or a name is expected")
        if kind is int and type(value) is not int:
            raise ValueError(f"is not a whole number (got {show_value(value)})")
        if any(isinstance(part, int | float) and abs(part) > LARGEST_NUMBER for part in parts):
            raise ValueError(f"is larger than {LARGEST_NUMBER:.0e} (got {show_value(value)})")
        if any(isinstance(part, str) and part and not part.isprintable() for part in parts):
            raise ValueError(f"holds a line break or a control character (got {show_value(value)})")
        return value


class Lora(ConfigPart):
    """Low-rank adapters in the attention and feed-forward layers of the language model."""

    rank: Annotated[int, Field(ge=1)] = 16
    alpha: Annotated[int, Field(ge=1)] = 32
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0


class Backbone(ConfigPart):
    """The network that reads images and text."""

    kind: Literal["qwen3-vl", "tiny", "perceptron"] = "qwen3-vl"
    """Qwen3-VL by transformers; a small network of this project that is always trained from
    scratch; or a smaller one that reads neither images nor text, only the further inputs (`state`,
    `track`)."""
    name: str = "Qwen/Qwen3-VL-4B-Instruct"
    """Hub id, local directory, or a config.json of Qwen3-VL; a config has no weights, so it needs
    `weights: random`."""
    revision: str | None = None
    """Commit, branch or tag on the hub."""
    weights: Literal["pretrained", "random"] = "pretrained"
    """Where the first weights come from."""
    lora: Lora | None = None
    """Train adapters in the language model, and nothing else of the backbone."""
    width: Annotated[int, Field(ge=16)] = 128
    """Of the small backbones: numbers a token."""
    layers: Annotated[int, Field(ge=1)] = 3
    """Of the small backbones: transformer layers, or hidden layers."""
    heads: Annotated[int, Field(ge=1)] = 4
    """Of the tiny backbone: attention heads."""
    keypoints: Annotated[int, Field(ge=1)] = 32
    """Of the tiny backbone: points that are located in each image."""
    words: Annotated[int, Field(ge=64)] = 1024
    """Entries of the hashed vocabulary, used where no tokenizer comes with the weights."""

    @model_validator(mode="after")
    def _divides(self) -> "Backbone":
        if self.kind == "tiny" and self.width % self.heads:
            raise ValueError(f"width {self.width} is no multiple of heads {self.heads}")
        return self


class Finder(ConfigPart):
    """Two small networks that find the target in the first camera: one in the whole image, made
    small, the other in a crop of the full image around what the first one found. They are trained
    first, on the target's true place in each image."""

    size: ImageSize = (48, 64)
    """Height and width of the small whole image."""
    crop: Annotated[int, Field(ge=16, le=512)] = 64
    """Height and width (px) of the crop."""
    reach: Annotated[float, Field(gt=0, le=0.2)] = 0.03
    """Distance (m) from the target's origin of the points that show its x axis and its z axis."""
    touches: bool = False
    """Whether the places at which both tools are when the target is first touched are found in
    every image, too. They show the size of a target that two arms grasp."""
    memory: bool = True
    """Whether the track follows from all images so far. Without, the velocity is 0, and a hidden
    target is lost."""
    goal: bool = False
    """Whether a second body is found and tracked as well: the one that is moved or, if that is the
    target, another one of the task, such as what it is put beside. Needs `objects_poses` in the
    export. In a task of one body it is the target again."""
    words: Annotated[int, Field(ge=0, le=256)] = 0
    """Numbers of the embedding of the sentence that says which target is meant; its encoder is
    trained with the finder. The policy is given them, too. With 0 no sentence is read."""
    nearest_task: bool = False
    """Whether a sentence is taken for the task of the demonstrations that it reads most like. Then
    unseen sentences are understood, and what tells two targets of one task apart is lost."""
    near: bool = False
    """Whether the policy is given the last centimetres of its ways to the bodies, and of its height
    over the table, as numbers of their own."""
    width: Annotated[int, Field(ge=8, multiple_of=4)] = 16
    """Filters of a layer."""
    steps: Annotated[int, Field(ge=1)] = 1500
    batch: Annotated[int, Field(ge=1)] = 64
    rate: Annotated[float, Field(gt=0)] = 3e-3
    """Highest learning rate."""

    @property
    def points(self) -> int:
        """Points of a body that are found: the origin, one on each of two axes, and the places of
        both tools."""
        return 5 if self.touches else 3

    @property
    def bodies(self) -> int:
        """Bodies that are found."""
        return 2 if self.goal else 1

    @model_validator(mode="after")
    def _agrees(self) -> "Finder":
        if self.touches and self.goal:
            raise ValueError("touches are found on one body: leave out touches or goal")
        if self.nearest_task and not self.words:
            raise ValueError("tasks are told by sentences: set words, or leave out nearest_task")
        return self


class Model(ConfigPart):
    """Inputs, queries and outputs."""

    backbone: Backbone = Backbone()
    chunk: Annotated[int, Field(ge=1, le=200)] = 16
    """K: joint targets in one answer."""
    history: Literal["flow", "frames", "none"] = "flow"
    """What is shown of the past: flow maps between earlier frames, the frames themselves, or
    nothing."""
    history_length: Annotated[int, Field(ge=1, le=16)] = 4
    """h: maps or frames of the past."""
    stride: Annotated[int, Field(ge=1, le=60)] = 4
    """Recorded frames between the two images of a flow pair, and between the moments that are
    predicted."""
    flow_scale: Literal["per_map", "fixed"] = "per_map"
    """Brightness of flow maps: relative to each map (the paper; loses speed), or px of
    displacement."""
    flow_full_scale: Annotated[float, Field(gt=0)] = 2.0
    """px of displacement, at the size of the map, that a fixed scale shows at full brightness."""
    world: Literal["features", "boxes", "none"] = "features"
    """What world queries predict of the target: encoder features (the paper), its box in the image,
    or nothing."""
    world_queries: Annotated[int, Field(ge=1, le=16)] = 4
    """N: later moments that are predicted."""
    sentences: bool = False
    """Whether words stand around the queries of Qwen3-VL, as in the published code: "Predict
    future object states:" before those of the world, "Predict the next K robot actions:" before
    those of the actions. The paper names none."""
    state: bool = False
    """Whether measured joints are an input."""
    history_times: bool = False
    """Whether the age (s) of every map of the past is an input."""
    clock: bool = False
    """Whether the time (s) since the start of the episode is an input."""
    track: Finder | None = None
    """Whether the target's position and velocity are an input, found in the images of the first
    camera up to now, and its way from each tool. The camera must stand still, and `data.image_size`
    must be that of its images."""
    arms: bool = False
    """Whether a small network chooses which arms act, and its choice is an input. It sees the track
    alone. A choice is kept until another one is much likelier: a policy that decides again at every
    chunk may start with both arms and arrive with none."""
    choosing: Annotated[float, Field(gt=0)] | None = None
    """Seconds from the start in which the arms are chosen, where `arms` is set: the small network
    learns these frames alone, and the choice then stays. The whole episode by default. Where an
    arm is at work, the track may look like the start of an episode of the other arm."""
    touched: bool = False
    """Whether a small network tells, from the other inputs, that the target has been touched; from
    then on this stays an input."""
    touching: Annotated[float, Field(gt=0)] | None = None
    """Seconds after the touch from which a touch is learned, where `touched` is set. Later a hand
    that carries the target may be where a hand that has not reached it is. All by default."""
    modes: Annotated[int, Field(ge=1, le=16)] = 1
    """Chunks among which the policy chooses. With one, demonstrations that do the same in different
    ways, such as a wrist turned to either side, teach what lies between them."""
    members: Annotated[int, Field(ge=1, le=16)] = 1
    """Perceptrons that learn beside each other from the same frames. The mean of their actions is
    executed."""
    offsets: bool = False
    """Whether actions of arms are predicted as differences from the joints measured now."""
    oracle: bool = False
    """Whether the action queries are told the target's future (training/puma/model/oracle.py): an
    upper bound, not a policy."""

    @model_validator(mode="after")
    def _sees(self) -> "Model":
        if self.backbone.kind == "perceptron" and not (self.state or self.track):
            raise ValueError("a perceptron reads no images: set model.track or model.state")
        if self.backbone.kind == "perceptron" and self.world != "none":
            raise ValueError("a perceptron predicts actions alone: set model.world to none")
        if self.members > 1 and (self.looks or self.modes > 1):
            raise ValueError(
                "members are perceptrons with one chunk each: set model.members or model.modes to 1"
            )
        if self.track and self.track.words and self.backbone.kind != "perceptron":
            raise ValueError("model.track.words are read beside a perceptron: set it to 0")
        if self.arms and self.track is None:
            raise ValueError("arms are chosen by the track of the target: set model.track")
        if self.choosing is not None and not self.arms:
            raise ValueError("no arms are chosen: set model.arms, or leave out model.choosing")
        if self.touching is not None and not self.touched:
            raise ValueError("no touch is told: set model.touched, or leave out model.touching")
        if self.touched and not (self.state and self.track):
            raise ValueError(
                "touches are told by joints and track: set model.state and model.track"
            )
        return self

    @property
    def looks(self) -> bool:
        """Whether the backbone reads images itself."""
        return self.backbone.kind != "perceptron"

    @property
    def queries(self) -> int:
        """World queries (none without `world`), then action queries."""
        return (0 if self.world == "none" else self.world_queries) + self.chunk
