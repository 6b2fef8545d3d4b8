"""The directory of a run: its owner, and the checkpoint from which training resumes."""

from dataclasses import replace
from pathlib import Path

from pipeline.data.atomic import sweep, write_atomic
from pipeline.data.parsing import read_yaml
from training.puma import checkpoint
from training.puma.config import Config, parse_config
from training.puma.corpus.mixture import Corpus
from training.puma.errors import TrainError
from training.puma.loop.loader import Loader
from training.puma.processes import trackers

LOG = "log.jsonl"


def claim(config: Config, out: Path) -> None:
    """Raise TrainError where `out` has checkpoints of another configuration: only the number of
    steps may change."""
    path = out / "config.yaml"
    if not path.exists() or not checkpoint.checkpoints(out):
        return
    before = trackers.flat(parse_config(read_yaml(path), str(path)).model_dump(mode="json"))
    now = trackers.flat(config.model_dump(mode="json"))
    keys = sorted(before.keys() | now.keys())
    other = [key for key in keys if before.get(key) != now.get(key) and key != "train.steps"]
    if other:
        said = ", ".join(f"{key} {before.get(key)}, now {now.get(key)}" for key in other[:3])
        raise TrainError(
            f"{out} holds a run of another configuration ({said}): choose another --out, or the"
            " same keys"
        )


def begin(config: Config, out: Path, step: int) -> None:
    """Write the configuration into the run's directory, and leave in its log what the first `step`
    steps wrote.

    A killed run has logged steps that its newest checkpoint does not know; they are done, and
    logged, again.
    """
    out.mkdir(parents=True, exist_ok=True)
    sweep(out)
    write_atomic(out / "config.yaml", config.to_yaml().encode())
    log = out / LOG
    if log.exists():
        held = log.read_bytes().splitlines(keepends=True)[:step]
        write_atomic(log, b"".join(held))


def as_before(corpus: Corpus, held: checkpoint.Loaded) -> Corpus:
    """The corpus with the scales of a checkpoint. Raises TrainError if anything else of its
    preprocessing differs."""
    before, now = held.preprocessing, corpus.preprocessing
    scales = {"state": before.state, "action": before.action}
    if replace(now, **scales) != before:
        values = zip(before.to_dict().items(), now.to_dict().values(), strict=True)
        [key, *_] = [key for (key, old), new in values if old != new and key not in scales]
        raise TrainError(
            f"{held.path}: was trained with another {key}: choose another train.start, or the data"
            " it was made for"
        )
    return replace(corpus, preprocessing=before)


def resume(path: Path, loader: Loader, corpus: Corpus) -> int:
    """Load the sampler of a checkpoint; returns its step. Raises TrainError if the data are not
    those of the run."""
    held = checkpoint.load(path)
    if held.preprocessing.digest != corpus.preprocessing.digest:
        raise TrainError(
            f"{path}: was trained with other preprocessing: its data has changed; choose another"
            " --out"
        )
    try:
        loader.sampler.load(held.sampler)
    except ValueError as error:
        raise TrainError(f"{path}: {error}; choose another --out") from error
    return held.step
