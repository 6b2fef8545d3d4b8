"""The model card: what a checkpoint was trained on and how, written from the run itself."""

import json
from pathlib import Path

import torch

from training.puma.config import Config
from training.puma.corpus.mixture import Corpus


def model_card(config: Config, corpus: Corpus, step: int, log: Path) -> str:
    """Markdown with the front matter of the Hugging Face hub."""
    model, prep = config.model, corpus.preprocessing
    base = f"base_model: {model.backbone.name}\n" if model.backbone.weights == "pretrained" else ""
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    validated = [row for row in rows if "validation_error" in row and row["step"] <= step]
    error = f"{validated[-1]['validation_error']:.4f} rad" if validated else "not measured"
    frames, episodes = (
        sum(map(len, corpus.train)),
        sum(len({*part.episode.tolist()}) for part in corpus.train),
    )
    physics = {
        row.physics_id
        for part in corpus.train
        for row in (part.cache.rows[i] for i in {*part.episode.tolist()})
    }
    sources = "\n".join(
        f"- `{s.dataset.name}` {s.where}, weight {s.weight:g}" for s in config.data.sources
    )
    constant = ", ".join(prep.action.constant) or "none"
    size = "x".join(map(str, prep.image_size))
    return f"""---
library_name: domino-data
pipeline_tag: robotics
{base}tags: [robotics, dynamic-manipulation, puma]
---

# {config.name}, step {step}

A PUMA policy for {", ".join(prep.embodiments)} at {prep.fps} Hz. It sees {", ".join(prep.cameras)} at {size} px
and answers with {model.chunk} joint targets, of which {config.execute.actions} are executed.

| | |
|---|---|
| backbone | {model.backbone.kind}, weights {model.backbone.weights} |
| history | {model.history}, {model.history_length} x {model.stride} frames, flow scale {model.flow_scale} |
| predicted of the target | {model.world}, {model.world_queries} moments |
| further inputs | {", ".join(n for n in ("state", "clock", "history_times", "oracle") if getattr(model, n)) or "none"} |
| trained | {step} of {config.train.steps} steps of {config.train.batch} samples, seed {config.train.seed} |
| data | {frames} frames of {episodes} episodes ({len(physics)} physics episodes) |
| joints scaled by | {config.data.normalisation}; nearly constant: {constant} |
| open-loop error, validation | {error} |
| preprocessing | `{prep.digest}` |
| torch | {torch.__version__} |

Data:

{sources}

```sh
domino-data evaluate --policy policy.py --cameras {",".join(prep.cameras)} --tasks TASK --levels 0,1 --out out/eval
puma serve . --port 8765
```
"""  # noqa: E501
