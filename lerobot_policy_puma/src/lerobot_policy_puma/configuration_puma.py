"""`--policy.type=puma`: a configuration of `training/puma`, with what LeRobot asks of one."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import NormalizationMode
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig

from training.puma.config import Config
from training.puma.reading import read_config


@PreTrainedConfig.register_subclass("puma")
@dataclass
class PumaConfig(PreTrainedConfig):
    """`puma` is the name or file of a configuration, `settings` change its keys. Raises ValueError
    for inputs LeRobot lacks."""

    puma: str = "puma-tiny"
    settings: list[str] = field(default_factory=list)
    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: {
            "VISUAL": NormalizationMode.IDENTITY,
            "STATE": NormalizationMode.MIN_MAX,
            "ACTION": NormalizationMode.MIN_MAX,
        }
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        asked = read_config(self.puma, self.settings)
        if any(
            setting.partition("=")[0] in ("model.clock", "model.history_times", "model.oracle")
            for setting in self.settings
        ):
            raise ValueError(
                "policy.settings: clock, history_times and oracle are no inputs here: use `puma"
                " train`"
            )
        if asked.model.track or asked.model.offsets:
            raise ValueError(
                f"policy.puma: {asked.name} tracks the target or predicts offsets, which only `puma"
                " train` does"
            )
        self.n_action_steps = asked.execute.actions

    @property
    def resolved(self) -> Config:
        """The configuration without what a LeRobot dataset cannot give, with its cameras where they
        are known already."""
        cameras = [key.rpartition(".")[2] for key in self.image_features or {}]
        off = [
            "model.world=none",
            "model.clock=false",
            "model.history_times=false",
            "model.oracle=false",
        ]
        return read_config(
            self.puma, [*self.settings, *off, *([f"data.cameras={cameras}"] if cameras else [])]
        )

    @property
    def observation_delta_indices(self) -> list[int]:
        """Frames of the past that a sample holds, and the present one."""
        model = self.resolved.model
        return (
            [0]
            if model.history == "none"
            else [-model.stride * i for i in range(model.history_length, -1, -1)]
        )

    @property
    def action_delta_indices(self) -> list[int]:
        """The steps of a chunk."""
        return list(range(self.resolved.model.chunk))

    @property
    def reward_delta_indices(self) -> None:
        """None are used."""
        return None

    def get_optimizer_preset(self) -> AdamWConfig:
        """AdamW with the values of the configuration; `get_optim_params` gives each group its
        rate."""
        train = self.resolved.train
        return AdamWConfig(
            lr=train.head_rate,
            betas=train.betas,
            eps=train.epsilon,
            weight_decay=train.weight_decay,
            grad_clip_norm=train.clip,
        )

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Warm-up and cosine of the configuration."""
        train = self.resolved.train
        return CosineDecayWithWarmupSchedulerConfig(
            peak_lr=train.head_rate,
            decay_lr=train.floor_rate,
            num_warmup_steps=train.warmup,
            num_decay_steps=train.steps,
        )

    def validate_features(self) -> None:
        """Raises ValueError for a dataset without images or actions."""
        if not self.image_features or self.action_feature is None:
            raise ValueError("puma needs at least one camera and the actions of a dataset")
