"""What stands between a LeRobot dataset or environment and the policy: joints scaled by the
dataset's statistics."""

from typing import Any

import torch
from lerobot.processor import (
    AddBatchDimensionProcessorStep,
    DeviceProcessorStep,
    NormalizerProcessorStep,
    PolicyProcessorPipeline,
    RenameObservationsProcessorStep,
    UnnormalizerProcessorStep,
)
from lerobot.processor.converters import policy_action_to_transition, transition_to_policy_action
from lerobot.utils.constants import (
    POLICY_POSTPROCESSOR_DEFAULT_NAME,
    POLICY_PREPROCESSOR_DEFAULT_NAME,
)

from lerobot_policy_puma.configuration_puma import PumaConfig

Stats = dict[str, dict[str, torch.Tensor]]


def make_puma_pre_post_processors(
    config: PumaConfig, dataset_stats: Stats | None = None
) -> tuple[Any, Any]:
    """The two pipelines."""
    device = DeviceProcessorStep(device=config.device or "cpu")
    features = {**(config.input_features or {}), **(config.output_features or {})}
    scaling = {"norm_map": config.normalization_mapping, "stats": dataset_stats}
    before = [
        RenameObservationsProcessorStep(rename_map={}),
        AddBatchDimensionProcessorStep(),
        device,
        NormalizerProcessorStep(features=features, **scaling),
    ]
    after = [
        UnnormalizerProcessorStep(features=config.output_features or {}, **scaling),
        DeviceProcessorStep(device="cpu"),
    ]
    return (
        PolicyProcessorPipeline(steps=before, name=POLICY_PREPROCESSOR_DEFAULT_NAME),
        PolicyProcessorPipeline(
            steps=after,
            name=POLICY_POSTPROCESSOR_DEFAULT_NAME,
            to_transition=policy_action_to_transition,
            to_output=transition_to_policy_action,
        ),
    )
