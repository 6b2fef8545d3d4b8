"""The user's choices, as frozen dataclasses. What decides a result enters its key; batch and
device do not.
"""

from dataclasses import dataclass, field

from pipeline.data.names import HEAD
from pipeline.data.parsing import FEWEST_PIXELS, MOST_PIXELS

from .flow import Colour, Farneback
from .stage import AnnotateError


@dataclass(frozen=True)
class FlowOptions:
    """The flow comes from `source` farneback or sim (exact), at `size` (width, height) in px."""

    source: str = "farneback"
    stride: int = 4
    size: tuple[int, int] = (64, 64)
    farneback: Farneback = field(default_factory=Farneback)
    colour: Colour = field(default_factory=Colour)

    def __post_init__(self) -> None:
        if not FEWEST_PIXELS <= min(self.size) <= max(self.size) <= MOST_PIXELS:
            size, limits = "x".join(map(str, self.size)), f"{FEWEST_PIXELS} to {MOST_PIXELS}"
            raise AnnotateError(f"flow size {size} is out of range: each side has {limits} pixels")


@dataclass(frozen=True)
class MaskOptions:
    """`source` is model (GroundingDINO boxes, SAM 2 masks) or sim (exact, from the renderer).
    `objects` are roles or names. `prompt` is metadata (the object's noun), description, or
    instruction (the paper's parser; one mask, named "instruction"). A detection of more than
    `max_area` of the image found nothing."""

    source: str = "model"
    objects: tuple[str, ...] = ("target", "manipulated")
    prompt: str = "metadata"
    box_threshold: float = 0.35
    text_threshold: float = 0.25
    max_area: float = 0.9
    detector: str = "grounding-dino-tiny"
    segmenter: str = "sam2.1-hiera-large"
    batch: int = 8


@dataclass(frozen=True)
class FeatureOptions:
    """Frozen encoder; `size` px square is a multiple of its patch."""

    encoder: str = "dinov2-base"
    size: int = 224
    batch: int = 16


@dataclass(frozen=True)
class WorldOptions:
    points: int = 64
    dense: bool = True


@dataclass(frozen=True)
class AnnotateOptions:
    cameras: tuple[str, ...] = (HEAD,)
    flow: FlowOptions = field(default_factory=FlowOptions)
    masks: MaskOptions = field(default_factory=MaskOptions)
    features: FeatureOptions = field(default_factory=FeatureOptions)
    world: WorldOptions = field(default_factory=WorldOptions)
