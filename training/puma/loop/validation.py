"""How far a network is off on the validation split, by the recorded frames alone."""

from collections.abc import Iterator

import numpy as np
import torch

from training.puma.config import Config
from training.puma.corpus.mixture import Corpus
from training.puma.corpus.samples import mixed_batch
from training.puma.corpus.split import SplitFrames
from training.puma.loop.loader import targets_of
from training.puma.model.inputs import Inputs, inputs_of, on
from training.puma.model.puma import Puma, Targets
from training.puma.model.text import Tokenizer
from training.puma.processes.parallel import in_shares


def open_loop(network: Puma, corpus: Corpus, device: torch.device | str) -> dict[str, float]:
    """Losses on validation frames, and `error`: mean absolute error of the actions that exist, in
    rad (grippers 0-1)."""
    was, totals, error, count, samples = network.training, dict[str, float](), 0.0, 0, 0
    network.eval()
    scale = torch.tensor(corpus.preprocessing.action.spread, dtype=torch.float32, device=device)
    with torch.no_grad():
        for part in corpus.validation:
            for inputs, targets in validation_batches(part, network.config, corpus, network.words):
                targets = on(targets, device)
                outputs = network(inputs.to(device))
                for name, value in network.losses(outputs, targets).items():
                    totals[name] = totals.get(name, 0.0) + float(value) * len(inputs)
                wrong = ((outputs.actions - targets.action).abs() * scale)[targets.action_valid]
                error, count, samples = (
                    error + float(wrong.sum()),
                    count + wrong.numel(),
                    samples + len(inputs),
                )
    in_shares(network)
    network.train(was)
    return {name: value / samples for name, value in totals.items()} | {
        "error": error / max(count, 1)
    }


def validation_batches(
    part: SplitFrames, config: Config, corpus: Corpus, words: Tokenizer
) -> Iterator[tuple[Inputs, Targets]]:
    """Evenly spaced frames of a part, the same every time, at most `train.validation_samples`."""
    count = min(len(part), config.train.validation_samples)
    places = np.linspace(0, len(part) - 1, count).round().astype(np.int64)
    for start in range(0, count, config.train.batch):
        some = places[start : start + config.train.batch]
        arrays, texts = mixed_batch(
            [part], (np.zeros(len(some), np.int64), some), config, corpus.preprocessing
        )
        yield inputs_of(arrays, texts, config, words), targets_of(arrays, config)
