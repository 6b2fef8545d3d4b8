"""Samples a second of training PUMA and of its loader alone, beside the bare backbone.

    python -m benchmarks.training [--config puma-tiny] [--set train.batch=64]

The data are made up, of the configuration's sizes, on disk and memory-mapped. The loader's figure
is one thread's: frames gathered from the cache at the size of the network, targets, masks and text
ids, ready as tensors. MFU counts forward and twice that for backward against the device's data
sheet, or on a CPU against a product of two matrices here.
"""

import argparse
import tempfile
from pathlib import Path

import torch

from benchmarks.hardware import hardware
from training.puma.measure.bench import learning, loading, made_up
from training.puma.model.puma import build_model
from training.puma.reading import read_config
from training.puma.train import sizes_of

LOADER_FLOOR = 500
"""Samples a second and core that the loader must reach."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", default="puma-tiny")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    config = read_config(options.config, options.set)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    with tempfile.TemporaryDirectory() as folder:
        corpus = made_up(config, Path(folder))
        torch.manual_seed(0)
        network = build_model(corpus.config, sizes_of(corpus)).to(device)
        weights = sum(weight.numel() for weight in network.parameters()) / 1e6
        rows = loading(corpus, network) | learning(corpus, network, device)
    print(hardware(torch.cuda.get_device_name(device) if device.type == "cuda" else ""))
    print(
        f"{config.name}: {weights:.2f} M weights, batch {config.train.batch},"
        f" {torch.get_num_threads()} threads\n"
    )
    for name, value in rows.items():
        floor = f"   (at least {LOADER_FLOOR})" if name.startswith("loader") else ""
        print(f"{name:44} {value:10.4g}{floor}")


if __name__ == "__main__":
    main()
