"""Two checks of a training set-up: a network can overfit a single batch, and a trained policy sees
what it was trained on."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pipeline.data.episode.frames import decode_frame
from pipeline.evaluate.policies.policy import Observation, Start
from training.puma import checkpoint
from training.puma.config import Config, MixtureSource
from training.puma.corpus.mixture import Corpus, open_corpus
from training.puma.corpus.samples import batch_of
from training.puma.corpus.shards import Shard, Shards
from training.puma.corpus.split import SplitFrames
from training.puma.errors import TrainError
from training.puma.finding.tracking import follow
from training.puma.loop.loader import Loader
from training.puma.loop.rates import groups
from training.puma.loop.validation import validation_batches
from training.puma.model.puma import Puma, build_model
from training.puma.policy import OraclePolicy, PumaPolicy
from training.puma.train import sizes_of

LOOKED_AT = 60
"""Images of a dataset in which errors of the finder are measured."""

ROUNDING = 1e-4
"""Metres (and m/s) by which a target that is found in one image at a time may differ from one found
in many."""


def overfit(config: Config, steps: int) -> dict[str, Any]:
    """Train on one batch; its loss before and after, and the number of samples."""
    corpus = open_corpus(config)
    torch.manual_seed(config.train.seed)
    network = build_model(config, sizes_of(corpus))
    corpus = follow(corpus, network)
    optimizer = torch.optim.AdamW(
        groups(network, config.train), betas=config.train.betas, eps=config.train.epsilon
    )
    batch = Loader(corpus, network.words).make()
    losses: list[float] = []
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = group["peak"] * (1 - step / steps)
        loss = network.losses(network(batch.inputs), batch.targets)["loss"]
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), config.train.clip)
        optimizer.step()
        losses.append(float(loss.detach()))
    return {"first": losses[0], "last": losses[-1], "samples": len(batch.inputs)}


def replay_check(folder: Path, data: Sequence[Path] | None, episodes: int) -> dict[str, Any]:
    """Show recorded episodes of the validation split (or of `data`) to a policy, as an evaluation
    would.

    `errors` by joint and `error` over all: mean absolute difference (rad, grippers 0-1) of the
    policy's chunks from what was commanded; `different` counts inputs that are not those that
    training makes of the same frame.
    """
    held = checkpoint.load(folder)
    # one part a dataset
    config = held.config.model_copy(
        update={"data": held.config.data.model_copy(update={"balance": "frames"})}
    )
    if data:
        sources = tuple(MixtureSource(dataset=path) for path in data)
        config = config.model_copy(
            update={"data": config.data.model_copy(update={"sources": sources})}
        )
    network = held.model()
    corpus = follow(open_corpus(config), network, trained=True)
    kind = OraclePolicy if config.model.oracle else PumaPolicy
    policy = kind(network, held.preprocessing)
    wrong, answers, different, shown = np.zeros(len(held.preprocessing.names)), 0, 0, 0
    validated = {id(part.cache): part for part in corpus.validation}
    for source, training in zip(config.data.sources, corpus.train, strict=True):
        # of a mixture, some datasets may have no episode in the validation split
        part = validated.get(id(training.cache)) if validated else training
        if part is None:
            continue
        shards = Shards(source, config)
        for number in sorted({*part.episode.tolist()})[:episodes]:
            shard = shards.read(shards.rows[number])
            errors, unlike = _replay(
                policy, shard, Corpus(config, [part], [], held.preprocessing, [1.0]), number
            )
            wrong, answers, different, shown = (
                wrong + sum(errors),
                answers + len(errors),
                different + unlike,
                shown + 1,
            )
    means = wrong / max(answers, 1)
    return {
        "errors": dict(zip(held.preprocessing.names, means.tolist(), strict=True)),
        "error": float(means.mean()),
        "answers": answers,
        "episodes": shown,
        "different": different,
    }


def errors(folder: Path) -> dict[str, dict[str, float]]:
    """Errors of a policy with a finder, by dataset, on validation episodes if there are any.

    Medians (px) over the images before the touch: of the `target` and of the `goal`, found by the
    sentences of training; of the target by sentences that training never read (`unseen`), and by
    those of another dataset (`swapped`). Mean absolute errors (rad, grippers 0-1) of the actions
    `before` and `after` the touch, the likeliest of several chunks.
    """
    held = checkpoint.load(folder)
    network = held.model().eval()
    opened = open_corpus(held.config)
    shown = opened.validation or opened.train
    corpus = follow(replace(opened, train=[], validation=shown), network, trained=True)
    sight, track = held.preprocessing.sight, held.config.model.track
    if (finder := network.finder) is None or sight is None or track is None:
        raise TrainError(f"{folder}: has no finder: only policies with model.track have one")
    out = dict[str, dict[str, float]]()
    caches = dict.fromkeys(part.cache.path for part in opened.train)
    names = {
        cache: "/".join(source.dataset.parts[-2:])
        for cache, source in zip(caches, held.config.data.sources, strict=True)
    }
    sentences = [part.cache.rows[0].unseen for part in corpus.validation]
    for number, part in enumerate(corpus.validation):
        arrays, rows = part.cache.arrays, [part.cache.rows[i] for i in part.episode]
        free = np.asarray(arrays["free"][part.frame])
        places = np.flatnonzero(free)[:: max(1, int(free.sum()) // LOOKED_AT)]
        frames = part.frame[places]
        images = np.stack([part.cache.images(held.config.data.cameras[0])[i] for i in frames])
        bodies = {"target": arrays["target"][frames]}
        if track.goal:
            bodies["goal"] = arrays["goal"][frames]
        truth = [sight.pixels(poses)[:, 0] for poses in bodies.values()]
        other = sentences[(number + len(sentences) // 2) % len(sentences)]
        told = {
            "": [rows[i].instructions[0] for i in places],
            "unseen": [rows[i].unseen[i % len(rows[i].unseen)] for i in places],
            "swapped": [other[i % len(other)] for i in places],
        }
        found = dict[str, float]()
        for name, texts in told.items() if track.words else [("", told[""])]:
            points, _ = finder.find(images, network.words.ids(texts))
            for body, (wanted, label) in enumerate(zip(truth, bodies, strict=True)):
                away = np.linalg.norm(points[:, body * track.points] - wanted, axis=1)
                if not name or not body:
                    found[name or label] = float(np.median(away))
        found |= _action_errors(network, part, corpus)
        out[names[part.cache.path]] = found
    return out


def _action_errors(network: Puma, part: SplitFrames, corpus: Corpus) -> dict[str, float]:
    """Mean absolute errors (rad) of the actions of a part before and after the touch."""
    scale, kinds = np.array(corpus.preprocessing.action.spread), ("before", "after")
    wrong: dict[str, list[np.ndarray]] = {name: [] for name in kinds}
    for inputs, targets in validation_batches(part, network.config, corpus, network.words):
        assert targets.free is not None
        with torch.inference_mode():
            off = (network(inputs).actions - targets.action).abs().numpy() * scale
        for name, chosen in zip(kinds, (targets.free, ~targets.free), strict=True):
            wrong[name].append(off[(targets.action_valid & chosen[:, None]).numpy()])
    each = {name: np.concatenate(some) for name, some in wrong.items()}
    return {name: float(values.mean()) for name, values in each.items() if len(values)}


def _replay(
    policy: PumaPolicy, shard: Shard, corpus: Corpus, number: int
) -> tuple[list[np.ndarray], int]:
    """Mean errors (A,) of every chunk of one episode, and how many inputs differ from those of
    training."""
    prep, part = policy.preprocessing, corpus.train[0]
    words, sizes = shard.row.instructions[0], prep.source_sizes
    policy.reset(Start(words, shard.row.embodiment, prep.names, prep.fps, prep.cameras, 0, sizes))
    if isinstance(policy, OraclePolicy):
        last = shard.row.length - 1
        policy.future = lambda times: shard.target[
            np.minimum(np.rint(times * prep.fps).astype(int), last)
        ]
    places = np.flatnonzero(part.episode == number)
    # of a corrected episode, what the policy did before the expert took over is shown and not
    # compared
    taught = int(part.frame[places[0]] - part.first[places[0]])
    errors, different = list[np.ndarray](), 0
    for t in range(0, shard.row.length - 1, policy.period):
        images = {camera: decode_frame(shard.images[camera][t]) for camera in prep.cameras}
        seen = Observation(shard.state[t].astype(np.float64), words, float(shard.time[t]), images)
        policy.act(seen)
        if t % policy.execute.actions or t < taught:
            continue
        wanted = batch_of(
            SplitFrames(part.cache, *(a[places] for a in _columns(part))),
            np.array([t - taught]),
            corpus.config,
            prep,
        )
        given = policy.given(seen)
        # which arms act, and whether they have touched, are answers of the policy, which may differ
        # from the expert's
        own = ("choice", "free")
        different += sum(
            not _alike(name, given[name], wanted[name]) for name in given if name not in own
        )
        recorded = shard.action[t : min(t + policy.config.model.chunk, shard.row.length - 1)]
        errors.append(np.abs(policy.plan(seen)[: len(recorded)] - recorded).mean(0))
    return errors, different


def _alike(name: str, given: np.ndarray, wanted: np.ndarray) -> bool:
    """Whether two inputs are the same; what a network found, or FK in float32 gave, within
    rounding."""
    return (
        np.allclose(given, wanted, atol=ROUNDING)
        if name in ("track", "tools")
        else np.array_equal(given, wanted)
    )


def _columns(part: SplitFrames) -> tuple[np.ndarray, ...]:
    return part.frame, part.first, part.last, part.episode
