"""PUMA as a PreTrainedPolicy: the network of `training/puma` on LeRobot's batches."""

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor

from lerobot_policy_puma.configuration_puma import PumaConfig
from training.puma.loop.rates import groups
from training.puma.model.inputs import Inputs
from training.puma.model.puma import Sizes, Targets, build_model
from training.puma.preprocess import Preprocessing, Scale, colour_of, resized


class PumaPolicy(PreTrainedPolicy):
    """Chunks of normalised joint targets; `select_action` plays `n_action_steps` of each."""

    config_class: Any = PumaConfig
    name: Any = "puma"

    def __init__(self, config: PumaConfig, **_: Any) -> None:
        super().__init__(config)
        config.validate_features()
        self.config: PumaConfig = config
        self.settings = config.resolved
        assert config.action_feature is not None
        joints = config.action_feature.shape[0]
        self.network = build_model(self.settings, Sizes(joints, 0))
        data, model, one = (
            self.settings.data,
            self.settings.model,
            Scale((0.0,) * joints, (1.0,) * joints),
        )
        # joints come scaled: only what makes images and flow maps is used of it
        self.preprocessing = Preprocessing(
            fps=15,
            embodiments=(),
            names=(),
            cameras=data.cameras,
            source_sizes={},
            image_size=data.image_size,
            flow_size=data.flow_size,
            history=model.history,
            history_length=model.history_length,
            stride=model.stride,
            state=one,
            action=one,
            colour=colour_of(self.settings),
        )
        self.reset()

    def get_optim_params(self) -> Any:
        """Groups (a list of dicts), each with a learning rate."""
        return [
            {k: v for k, v in group.items() if k != "peak"}
            for group in groups(self.network, self.settings.train)
        ]

    def reset(self) -> None:
        """Begin an episode."""
        self._seen: deque[list[Any]] = deque(
            maxlen=self.settings.model.history_length * self.settings.model.stride + 1
        )
        self._queue: deque[Tensor] = deque()

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Loss of a batch whose images are (B,T,3,H,W), T the past and the present, and whose
        actions (B,K,A)."""
        frames = {key: batch[key] for key in self.config.image_features}
        if any(value.ndim == 4 for value in frames.values()):
            frames = {key: value[:, None] for key, value in frames.items()}
        images = {key: _bytes(value[:, -1]) for key, value in frames.items()}
        first = next(iter(frames.values()))
        glances = [[self.preprocessing.glance(image) for image in _bytes(row)] for row in first]
        wanted = batch[ACTION]
        pad = batch.get("action_is_pad")
        valid = (
            torch.ones(wanted.shape[:2], dtype=torch.bool, device=wanted.device)
            if pad is None
            else ~pad
        )
        outputs = self.network(self._inputs(images, glances, batch))
        losses = self.network.losses(outputs, Targets(wanted, valid))
        return losses["loss"], {name: float(value.detach()) for name, value in losses.items()}

    @torch.no_grad()
    def predict_action_chunk(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """Chunks (B,K,A) for the present images (B,3,H,W), with the past that `select_action` has
        kept."""
        self.eval()
        images = {key: _bytes(_present(batch[key])) for key in self.config.image_features}
        return self.network(self._inputs(images, self._history(), batch)).actions

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """The next actions (B,A)."""
        first = next(iter(self.config.image_features))
        self._seen.append(
            [self.preprocessing.glance(image) for image in _bytes(_present(batch[first]))]
        )
        if not self._queue:
            self._queue.extend(
                self.predict_action_chunk(batch)[:, : self.config.n_action_steps].transpose(0, 1)
            )
        return self._queue.popleft()

    def _history(self) -> list[list[Any]]:
        """Glances of each environment at the strides, the oldest first; the first one stands for
        what was before it."""
        model, last = self.settings.model, len(self._seen) - 1
        at = [max(0, last - model.stride * i) for i in range(model.history_length, -1, -1)]
        return [[self._seen[i][row] for i in at] for row in range(len(self._seen[0]))]

    def _inputs(
        self, images: Mapping[str, Any], glances: list[list[Any]], batch: Mapping[str, Any]
    ) -> Inputs:
        model, device = self.settings.model, next(self.parameters()).device
        size = self.settings.data.image_size
        views = np.stack(
            [
                np.stack([resized(image, size) for image in images[key]])
                for key in self.config.image_features
            ],
            1,
        )
        count = len(views)
        words = batch.get("task") or [""] * count
        past = None
        if model.history != "none":
            past = torch.from_numpy(np.stack([self.preprocessing.past(row) for row in glances]))
        state = _present(batch[OBS_STATE], 2).float() if model.state else None
        return Inputs(
            text=self.network.words.ids(words),
            views=torch.from_numpy(views),
            past=past,
            state=state,
        ).to(device)


def _present(value: Tensor, dimensions: int = 4) -> Tensor:
    """A batch without the dimension of time: its last entry."""
    return value[:, -1] if value.ndim > dimensions else value


def _bytes(images: Tensor) -> np.ndarray:
    """Images (N,3,H,W) 0-1 as (N,H,W,3) uint8."""
    return (
        (images.detach().cpu() * 255)
        .round()
        .clamp(0, 255)
        .to(torch.uint8)
        .permute(0, 2, 3, 1)
        .contiguous()
        .numpy()
    )
