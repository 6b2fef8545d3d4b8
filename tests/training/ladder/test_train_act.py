"""The frozen statistics from which ACT starts."""

import pytest


def test_measured_layers_give_features_of_mean_zero_and_variance_one():
    torch = pytest.importorskip("torch")
    frozen = pytest.importorskip("torchvision.ops").FrozenBatchNorm2d
    from training.ladder.train_act import measure_statistics

    torch.manual_seed(0)
    convolution = torch.nn.Conv2d(3, 8, 3), torch.nn.Conv2d(8, 4, 3)
    network = torch.nn.Sequential(
        convolution[0], frozen(8), torch.nn.ReLU(), convolution[1], frozen(4)
    )
    images = 5 + 3 * torch.randn(16, 3, 12, 12)
    before = network(images)
    assert before.std(dim=(0, 2, 3)).max() < 0.5 or before.mean(dim=(0, 2, 3)).abs().max() > 0.5
    measure_statistics(network, images)
    after = network(images).detach()
    assert after.mean(dim=(0, 2, 3)).abs().max() < 1e-5
    assert (after.var(dim=(0, 2, 3)) - 1).abs().max() < 1e-3
    # frozen: other images are scaled by the same numbers, and nothing is left that measures again
    assert network(2 * images).mean(dim=(0, 2, 3)).abs().max() > 0.05 and torch.equal(
        network(images), after
    )
