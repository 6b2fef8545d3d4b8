"""lerobot-train for ACT without pretrained weights: `python -m training.ladder.train_act WORDS`,
with the words of lerobot-train.

ACT's backbone normalises by frozen statistics, which belong to pretrained weights. Beside random
weights they change nothing: the features of different images hardly differ, and training makes them
grow a millionfold. So they are measured first, on images of the dataset, and training starts from
there.
"""

import sys
from collections.abc import Sequence
from tempfile import TemporaryDirectory
from typing import Any

import torch

IMAGES = 64
"""Images of each camera on which the statistics are measured."""


def main(words: Sequence[str]) -> None:
    """Train as lerobot-train does, from a policy that `write_start` made if the configuration names
    no pretrained backbone."""
    from lerobot.scripts.lerobot_train import main as train

    with TemporaryDirectory() as start:
        if write_start(words, start):
            words = [
                *(word for word in words if not word.startswith("--policy.type=")),
                f"--policy.path={start}",
            ]
        sys.argv = ["lerobot-train", *words]
        train()


def write_start(words: Sequence[str], out: str) -> bool:
    """Write a policy with random weights and measured statistics to a directory; whether there was
    need of one."""
    import draccus
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.factory import make_policy, make_pre_post_processors
    from lerobot.utils.constants import IMAGENET_STATS

    prefix, kind = "--policy.", "--policy.type="
    of_policy = [
        word.removeprefix(prefix)
        for word in words
        if word.startswith(prefix) and not word.startswith(kind)
    ]
    config = draccus.parse(ACTConfig, args=[f"--{word}" for word in of_policy])
    if config.pretrained_backbone_weights is not None:
        return False
    given = dict(word.removeprefix("--").split("=", 1) for word in words if "=" in word)
    names: dict[str, Any] = {
        key: given[f"dataset.{key}"] for key in ("repo_id", "root", "video_backend")
    }
    torch.manual_seed(int(given["seed"]))
    dataset = LeRobotDataset(**names)
    policy: Any = make_policy(config, ds_meta=dataset.meta)
    cameras: list[str] = dataset.meta.camera_keys
    if not cameras:
        return False
    # lerobot-train scales images by these statistics, whatever the dataset's are
    stats: Any = {
        key: value | (IMAGENET_STATS if key in cameras else {})
        for key, value in (dataset.meta.stats or {}).items()
    }
    processors: Any = make_pre_post_processors(policy.config, dataset_stats=stats)
    chosen = torch.randperm(len(dataset), generator=torch.Generator().manual_seed(0))[:IMAGES]
    samples: list[Any] = [dataset[int(i)] for i in chosen]
    images = processors[0](
        {key: torch.stack([sample[key] for sample in samples]) for key in cameras}
    )
    measure_statistics(policy.model.backbone, torch.cat([images[key] for key in cameras]))
    for part in (policy, *processors):
        part.save_pretrained(out)
    return True


def measure_statistics(network: Any, images: torch.Tensor) -> None:
    """Set mean and variance of every frozen batch normalisation to those of its input, for images
    (B,3,h,w)."""
    from torchvision.ops import FrozenBatchNorm2d

    def measure(layer: Any, inputs: tuple[torch.Tensor, ...]) -> None:
        variance, mean = torch.var_mean(inputs[0], dim=(0, 2, 3))
        layer.running_var.copy_(variance)
        layer.running_mean.copy_(mean)

    layers = [layer for layer in network.modules() if isinstance(layer, FrozenBatchNorm2d)]
    hooks = [layer.register_forward_pre_hook(measure) for layer in layers]
    with torch.no_grad():
        network(images)
    for hook in hooks:
        hook.remove()


if __name__ == "__main__":
    main(sys.argv[1:])
