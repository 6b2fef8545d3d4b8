"""What the network takes: tensors of a batch, made from arrays in the same way in training and when
the policy acts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.puma.config import Config
from training.puma.model.text import Tokenizer
from training.puma.track import aims


@dataclass(eq=False)
class Inputs:
    """B samples. `views` (B,V,h,w,3) and `past` (B,h,fh,fw,3) are uint8, `text` (B,L) token ids,
    padded at its end with -1.

    `state` (B,A) normalised, `clock` (B,1) s, `past_time` (B,h) s, `aims` (B,F), `choice` (B,),
    which arms act, `touched` (B,1), 0 or 1, and `oracle` (B,F) are there where the model takes
    them, `views` where the backbone looks at images.
    """

    text: Tensor
    views: Tensor | None = None
    past: Tensor | None = None
    state: Tensor | None = None
    clock: Tensor | None = None
    past_time: Tensor | None = None
    oracle: Tensor | None = None
    aims: Tensor | None = None
    choice: Tensor | None = None
    touched: Tensor | None = None

    def to(self, device: torch.device | str) -> "Inputs":
        """The same on a device."""
        return on(self, device)

    def __len__(self) -> int:
        return len(self.text)


def stacked(some: Sequence[Inputs]) -> Inputs:
    """Inputs with the same parts and lengths as one, row after row."""
    parts = ((f.name, [getattr(rows, f.name) for rows in some]) for f in fields(Inputs))
    whole: dict[str, Any] = {
        name: None if values[0] is None else torch.cat(values) for name, values in parts
    }
    return Inputs(**whole)


def on[T](values: T, device: torch.device | str) -> T:
    """A dataclass of tensors, or of None, on a device."""
    return type(values)(
        **{
            name: None if v is None else v.to(device, non_blocking=True)
            for name, v in vars(values).items()
        }
    )


def inputs_of(
    arrays: Mapping[str, NDArray[Any]], texts: Sequence[str], config: Config, words: Tokenizer
) -> Inputs:
    """Inputs from the arrays of `training.puma.corpus.samples.batch_of`, or the same arrays made
    while a policy acts."""
    model = config.model
    found: dict[str, Tensor] = {"text": words.ids(texts)}
    if model.looks:
        found["views"] = torch.from_numpy(
            np.stack([arrays[f"image_{camera}"] for camera in config.data.cameras], 1)
        )
    if model.history != "none":
        found["past"] = torch.from_numpy(np.ascontiguousarray(arrays["past"]))
        if model.history_times:
            found["past_time"] = torch.from_numpy(arrays["past_time"])
    if model.state:
        found["state"] = torch.from_numpy(arrays["state"])
    if model.clock:
        found["clock"] = torch.from_numpy(arrays["clock"])[:, None]
    if model.track:
        seen = aims(arrays["track"], arrays["tools"], model.track.bodies, model.track.near)
        found["aims"] = torch.from_numpy(seen)
    if model.arms:
        found["choice"] = torch.from_numpy(arrays["choice"])
    if model.touched:
        found["touched"] = torch.from_numpy(~arrays["free"]).float()[:, None]
    if model.oracle:
        found["oracle"] = torch.from_numpy(arrays["oracle"])
    return Inputs(**found)
