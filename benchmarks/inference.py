"""Milliseconds that PUMA takes for an answer at batch 1, eager and compiled, beside the bare
backbone.

    python -m benchmarks.inference [--config puma-tiny] [--set data.cameras=[head_camera]] [--no-compile]

An answer is: images at the size of the network, flow maps of the past from grey images that are
there already, text ids, network, joint targets. Anchor: the paper's 103.7 ms for three views and
four maps on an RTX 4090 (98.3 of it the backbone).
"""  # noqa: E501

import argparse
import tempfile
from pathlib import Path

import torch

from benchmarks.hardware import hardware
from training.puma.measure.bench import answering, made_up
from training.puma.model.puma import build_model
from training.puma.reading import read_config
from training.puma.train import sizes_of


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", default="puma-tiny")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--no-compile", action="store_true")
    options = parser.parse_args()
    config = read_config(options.config, options.set)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    with tempfile.TemporaryDirectory() as folder:
        corpus = made_up(config, Path(folder))
        torch.manual_seed(0)
        network = build_model(corpus.config, sizes_of(corpus)).to(device)
        rows = answering(corpus, network, device)
        if not options.no_compile:
            rows |= answering(corpus, network, device, compiled=True)
    print(hardware(torch.cuda.get_device_name(device) if device.type == "cuda" else ""))
    print(f"{config.name}: {len(config.data.cameras)} views, {torch.get_num_threads()} threads\n")
    for name, value in rows.items():
        print(f"{name:44} {value:10.4g}")


if __name__ == "__main__":
    main()
