"""From what a robot measures and sees to what the network takes, and back: one object for training,
evaluation and server.

It is saved beside the weights, with its hash; training arrays are made by the functions here, so a
policy sees the same bytes.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.flow import (
    Colour,
    Farneback,
    bit_stable,
    colour_flow,
    farneback,
    shrink_grey,
)
from pipeline.data.keys import digest
from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.track import TargetView

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Scale:
    """values = centre + spread * normalised, for every joint; `constant` names those whose spread
    is the floor."""

    centre: tuple[float, ...]
    spread: tuple[float, ...]
    constant: tuple[str, ...] = ()

    def forward(self, values: NDArray[Any]) -> Floats:
        """Joints (..., A) in rad, grippers 0-1, to normalised ones."""
        return ((np.asarray(values, np.float64) - self.centre) / self.spread).astype(np.float32)

    def backward(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Inverse of `forward`."""
        return np.asarray(values, np.float64) * self.spread + self.centre


def fit_scale(values: NDArray[Any], names: Sequence[str], kind: str, floor: float) -> Scale:
    """The scale of values (N,A): min_max maps the range to [-1,1], quantile that of 1 % to 99 %,
    mean_std to deviations of 1.

    A joint whose half range (or deviation) is below `floor` is divided by `floor`: noise on a joint
    that holds still stays small.
    """
    values = np.asarray(values, np.float64)
    if kind == "mean_std":
        centre, spread = values.mean(0), values.std(0)
    else:
        low, high = (
            (values.min(0), values.max(0))
            if kind == "min_max"
            else np.quantile(values, (0.01, 0.99), axis=0)
        )
        centre, spread = (low + high) / 2, (high - low) / 2
    still = spread < floor
    constant = tuple(name for name, s in zip(names, still, strict=True) if s)
    return Scale(tuple(centre.tolist()), tuple(np.where(still, floor, spread).tolist()), constant)


@dataclass(frozen=True)
class Preprocessing:
    """What stands between the world and the network.

    `source_sizes` are the (height, width) of the images of each camera as they come, `image_size`
    and `flow_size` those at the network. The past is looked at through the first camera, at
    multiples of `stride` recorded frames. `state` and `action` scale joints in the order of
    `names`. `setup` are the keys of the setup of the training data that are not the defaults
    (data/setup/__init__.py). `sight` is how the first camera sees targets, where they are tracked.
    """

    fps: int
    embodiments: tuple[str, ...]
    names: tuple[str, ...]
    cameras: tuple[str, ...]
    source_sizes: Mapping[str, tuple[int, int]]
    image_size: tuple[int, int]
    flow_size: tuple[int, int]
    history: str
    history_length: int
    stride: int
    state: Scale
    action: Scale
    colour: Colour = field(default_factory=Colour)
    farneback: Farneback = field(default_factory=Farneback)
    setup: Mapping[str, Any] = field(default_factory=dict[str, Any])
    sight: TargetView | None = None

    def image(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image (H,W,3) uint8 at the size of the network: area average; the aspect is not
        kept."""
        return resized(rgb, self.image_size)

    def glance(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What is kept of a past image: a grey one (h,w) for flow, a small one (h,w,3)
        otherwise."""
        if self.history == "frames":
            return resized(rgb, self.flow_size)
        return shrink_grey(rgb, (self.flow_size[1], self.flow_size[0]))

    def past(self, glances: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """History images (h, fh, fw, 3) uint8, oldest first, of h + 1 glances that are `stride`
        frames apart, the last one now.

        Flow maps show consecutive pairs; frames are all but the last.
        """
        if self.history == "frames":
            return np.stack(glances[:-1])
        return np.stack([self.flow_map(a, b) for a, b in pairwise(glances)])

    def flow_map(self, before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """RGB flow map (fh,fw,3) of two grey images. The same image twice gives a black map, as the
        annotation has at the start."""
        flow = (
            np.zeros((*before.shape, 2), np.float32)
            if before is after
            else farneback(before, after, self.farneback)
        )
        return color_maps(flow[None].astype(np.float16), self.colour)[0]

    @property
    def digest(self) -> str:
        """Hash of everything above."""
        return digest(self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = json.loads(json.dumps(asdict(self)))
        return {
            key: value for key, value in values.items() if value or key not in ("setup", "sight")
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Preprocessing":
        """Inverse of `to_dict`. Raises TrainError for something else."""
        try:
            given = {"setup": {}, "sight": None, **values}
            for key in ("embodiments", "names", "cameras", "image_size", "flow_size"):
                given[key] = tuple(given[key])
            given["source_sizes"] = {
                name: (int(size[0]), int(size[1])) for name, size in given["source_sizes"].items()
            }
            for key in ("state", "action"):
                given[key] = Scale(**{name: tuple(value) for name, value in given[key].items()})
            given["sight"] = TargetView.parse(given["sight"]) if given["sight"] else None
            given["colour"], given["farneback"] = (
                Colour(**given["colour"]),
                Farneback(**given["farneback"]),
            )
            if given.keys() != {f.name for f in fields(cls)}:
                raise TypeError("it has other keys")
            return cls(**given)
        except (KeyError, TypeError, ValueError) as error:
            raise TrainError(
                f"the preprocessing of this checkpoint is of another version ({error}): train again"
            ) from error


def colour_of(config: Config) -> Colour:
    """How flow maps are colored."""
    model = config.model
    return Colour(normalisation=model.flow_scale, full_scale=model.flow_full_scale)


def color_maps(flow: NDArray[np.float16], colour: Colour) -> NDArray[np.uint8]:
    """RGB maps (N,h,w,3) of flows (N,h,w,2) px as annotations store them."""
    return colour_flow(flow, colour)[0]


def resized(rgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """An image (H,W,3) at (height, width): area average, the same bytes on every machine."""
    if rgb.shape[:2] == size:
        return rgb
    with bit_stable():
        return np.asarray(cv2.resize(rgb, size[::-1], interpolation=cv2.INTER_AREA), np.uint8)
