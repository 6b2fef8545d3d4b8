"""The training loop: one process or several by accelerate; it resumes exactly where it stopped."""

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from accelerate import Accelerator
from torch import nn
from tqdm import tqdm

from training.puma import checkpoint
from training.puma.config import Config
from training.puma.corpus.mixture import Corpus, open_corpus
from training.puma.errors import TrainError
from training.puma.finding.learning import sentences_of
from training.puma.finding.tracking import follow
from training.puma.loop import card, runs
from training.puma.loop.loader import Batch, Loader, Share, parts_of
from training.puma.loop.rates import groups, rate_at
from training.puma.loop.runs import LOG
from training.puma.loop.validation import open_loop
from training.puma.model.inputs import on
from training.puma.model.puma import Puma, Sizes, build_model
from training.puma.processes import memory, trackers
from training.puma.processes.flops import peak_flops, step_flops
from training.puma.processes.parallel import (
    is_shared,
    one_first,
    prepare,
    share_weights,
    shell_of,
    start_accelerator,
    whole,
)


@dataclass(eq=False)
class Timing:
    """Seconds spent since the last report, by kind."""

    data: float = 0.0
    forward: float = 0.0
    backward: float = 0.0
    samples: int = 0
    began: float = field(default_factory=time.perf_counter)

    def rate(self) -> float:
        """Samples a second."""
        return self.samples / max(time.perf_counter() - self.began, 1e-9)


@dataclass(eq=False)
class Result:
    """The newest checkpoint, and the rows of the log that this call wrote."""

    checkpoint: Path
    rows: list[dict[str, Any]]


Track = Callable[[Corpus, Puma, bool, bool], Corpus]
"""Adds what a network sees of targets to a corpus, as training.puma.finding.tracking.follow
does."""

FINDER = "finder.safetensors"
"""The finder of a run, written when it has been trained: a run that is stopped begins there."""


def train(
    config: Config,
    out: Path,
    steps: int | None = None,
    quiet: bool = False,
    track: Track | None = None,
) -> Result:
    """Train until `train.steps`, or until `steps` have been done in all, from the newest checkpoint
    in `out` if there is one.

    Raises TrainError for bad input, and for a directory that holds a run of another configuration.
    """
    accelerator = start_accelerator(config.train, out)
    main = accelerator.is_main_process
    runs.claim(config, out)
    memory.check(config, accelerator)  # before hours of decoding

    def tell(text: str) -> None:
        if main and not quiet:
            print(text, flush=True)

    corpus = one_first(lambda: open_corpus(config, tell), accelerator)
    if config.data.validation and not corpus.validation:
        tell(
            "no validation errors: no episode fell into the split (data.validation"
            f" {config.data.validation}); build more episodes"
        )
    sizes = sizes_of(corpus)
    if config.train.start is not None:
        before = checkpoint.load(config.train.start)
        corpus = runs.as_before(corpus, before)
        sizes = replace(sizes, tasks=before.sizes.tasks)
    torch.manual_seed(config.train.seed)
    shared = is_shared(accelerator, config.train)
    held, step = checkpoint.checkpoints(out), 0
    if main or not shared:
        network = build_model(config, sizes)
        if held:
            checkpoint.load_weights(network, held[-1])
        elif config.train.start is not None:
            checkpoint.begin_from(network, checkpoint.load(config.train.start).path)
    else:
        network = shell_of(config, sizes)
    if network.finder is not None:
        network.finder.to(accelerator.device)
    track = track or partial(follow, kept=out / FINDER if main else None)
    corpus = track(corpus, network, bool(held or config.train.start is not None), quiet or not main)
    loader = Loader(
        corpus, network.words, Share(accelerator.process_index, accelerator.num_processes)
    )
    if held:
        step = runs.resume(held[-1], loader, corpus)
    if shared:
        network = share_weights(
            network, shell_of(config, sizes) if main else network, accelerator, config.train
        )
    adamw = torch.optim.AdamW(
        groups(network, config.train), betas=config.train.betas, eps=config.train.epsilon
    )
    model, optimizer = prepare(network, adamw, accelerator, config.train)
    if held:
        checkpoint.load_optimizer(network, adamw, held[-1])
    run = _Run(config, out, accelerator, model, network, optimizer, adamw, corpus)
    if main:
        runs.begin(config, out, step)
    rows, last = list[dict[str, Any]](), min(steps or config.train.steps, config.train.steps)
    timing = Timing()
    bar = tqdm(total=last, initial=step, unit="step", disable=quiet or not main, dynamic_ncols=True)
    trackers.begin(accelerator, config)
    try:
        for batch in loader:
            if step >= last:
                break
            row = run.step(batch, step, timing)
            step += 1
            done = step == last
            if step % config.train.validate_every == 0 or done:
                row |= run.validate()
            rows.append(row)
            bar.update()
            if step % 10 == 0 or done:
                bar.set_postfix(run.report(row, timing))
                timing = Timing()
            if main:
                run.log(row)
            if step % config.train.save_every == 0 or done:
                run.save(step, batch)
    finally:
        bar.close()
        loader.close()
        trackers.end(accelerator)
    return Result(checkpoint.newest(out), rows)


def sizes_of(corpus: Corpus) -> Sizes:
    """Sizes of the network that follow from the data."""
    arrays = corpus.train[0].cache.arrays
    track = corpus.config.model.track
    return Sizes(
        len(corpus.preprocessing.names),
        arrays["world"].shape[1] if "world" in arrays else 0,
        len(sentences_of(corpus)) if track is not None and track.nearest_task else 0,
    )


@dataclass(eq=False)
class _Run:
    config: Config
    out: Path
    accelerator: Accelerator
    model: nn.Module
    network: Puma
    optimizer: Any
    adamw: torch.optim.Optimizer
    corpus: Corpus
    _flops: float = 0.0
    _waited: float = field(default_factory=time.perf_counter)

    def step(self, batch: Batch, step: int, timing: Timing) -> dict[str, Any]:
        """One step of the optimiser."""
        settings, began = self.config.train, time.perf_counter()
        timing.data += began - self._waited
        device = self.accelerator.device
        for group in self.optimizer.param_groups:
            group["lr"] = group["peak"] * rate_at(step, settings)
        self.model.train()
        totals: dict[str, float] = {}
        for part in parts_of(batch, settings.accumulate):
            start = time.perf_counter()
            inputs, targets = part.inputs.to(device), on(part.targets, device)
            if not self._flops:
                self._flops = step_flops(self.network, inputs)
            with self.accelerator.autocast():
                outputs = self.model(inputs)
            losses = self.network.losses(outputs, targets)
            middle = time.perf_counter()
            self.accelerator.backward(losses["loss"] / settings.accumulate)
            for name, value in losses.items():
                totals[name] = totals.get(name, 0.0) + float(value.detach()) / settings.accumulate
            timing.forward += middle - start
            timing.backward += time.perf_counter() - middle
        if self.accelerator.num_processes > 1:
            values: Any = self.accelerator.reduce(
                torch.tensor(list(totals.values()), device=device), "mean"
            )
            totals = dict(zip(totals, values.tolist(), strict=True))
        if not math.isfinite(totals["loss"]):
            fix = (
                "lower train.head_rate and train.backbone_rate, or look for values in the data that"
                " are no numbers"
            )
            raise TrainError(f"the loss is {totals['loss']} at step {step + 1}: {fix}")
        start = time.perf_counter()
        norm = self.accelerator.clip_grad_norm_(self.model.parameters(), settings.clip)
        self.optimizer.step()
        self.optimizer.zero_grad()
        timing.backward += time.perf_counter() - start
        timing.samples += settings.batch
        self._waited = time.perf_counter()
        rate = self.optimizer.param_groups[0]["lr"]
        return {
            "step": step + 1,
            **totals,
            "rate": rate,
            "norm": float(0.0 if norm is None else whole(norm)),
        }

    def validate(self) -> dict[str, float]:
        """Open-loop error on the validation split."""
        if not self.corpus.validation:
            return {}
        found = open_loop(self.network, self.corpus, self.accelerator.device)
        self._waited = time.perf_counter()
        return {f"validation_{name}": value for name, value in found.items()}

    def report(self, row: Mapping[str, Any], timing: Timing) -> dict[str, str]:
        """What the bar shows."""
        total = max(timing.data + timing.forward + timing.backward, 1e-9)
        split = "/".join(
            f"{100 * t / total:.0f}" for t in (timing.data, timing.forward, timing.backward)
        )
        mfu = timing.rate() * self._flops / peak_flops(self.accelerator.device)
        shown = {
            "loss": f"{row['loss']:.3f}",
            "samples/s": f"{timing.rate():.0f}",
            "data/fwd/bwd %": split,
        }
        if "validation_error" in row:
            shown["error"] = f"{row['validation_error']:.4f}"
        return shown | {"MFU %": f"{100 * mfu:.0f}"}

    def log(self, row: Mapping[str, Any]) -> None:
        """Append to the log, and tell the trackers."""
        with (self.out / LOG).open("a") as file:
            file.write(json.dumps(row) + "\n")
        self.accelerator.log(
            {name: value for name, value in row.items() if name != "step"}, step=row["step"]
        )

    def save(self, step: int, batch: Batch) -> None:
        """Write a checkpoint."""
        self.accelerator.wait_for_everyone()
        tensors = checkpoint.tensors_of(
            self.network, self.adamw, keep=self.accelerator.is_main_process
        )
        if self.accelerator.is_main_process:
            text = card.model_card(self.config, self.corpus, step, self.out / LOG)
            standing = checkpoint.Standing(step, batch.sampler, text)
            path = checkpoint.checkpoint_path(self.out, step)
            checkpoint.save(path, self.network, tensors, self.corpus.preprocessing, standing)
            checkpoint.prune(self.out, self.config.train.keep)
        self.accelerator.wait_for_everyone()
        self._waited = time.perf_counter()
