"""The parts of a LeRobot v3.0 dataset that lerobot's own functions write: schema, info.json, tasks,
statistics and card.

Importing lerobot takes some ten seconds (torch, transformers), so it happens here, once an export,
and never in the processes that encode. Three parts are made by us, and the tests hold them against
what lerobot writes for the same frames:

- data files: `add_frame` and `save_episode` take one frame at a time and keep images as PNG files
  on the way;
- videos: its encoders read those PNG files, or leave filter and threads of AV1 open: bytes would
  not follow from frames alone;
- meta/episodes: its writer infers the type of a column from its values, and a time is null where an
  event did not happen.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.data.errors import DominoError
from pipeline.export.shared.card import LICENSE, PAPER, TAGS, size_category
from pipeline.export.shared.statistics import Stats


class MissingLerobot(DominoError):
    """lerobot cannot be imported; the message names the package to install."""


def require_lerobot() -> tuple[Any, Any, Any]:
    """lerobot's modules feature_utils, io_utils and utils. Raises MissingLerobot."""
    try:
        from lerobot.datasets import feature_utils, io_utils, utils
    except ImportError as error:
        raise MissingLerobot(
            f"--format lerobot needs lerobot ({error}): install domino-data[lerobot]"
        ) from error
    return feature_utils, io_utils, utils


def data_schema(features: Mapping[str, Mapping[str, Any]]) -> pa.Schema:
    """Schema of the data files: every feature but the videos, with Hugging Face features in the
    metadata.

    Raises MissingLerobot.
    """
    feature_utils, _, _ = require_lerobot()
    shaped = {
        name: {**feature, "shape": tuple(feature["shape"])} for name, feature in features.items()
    }
    return feature_utils.get_hf_features_from_features(shaped).arrow_schema


def write_meta(
    root: Path,
    info: Mapping[str, Any],
    tasks: Sequence[str],
    stats: Mapping[str, Stats],
    description: str,
) -> None:
    """meta/info.json, meta/tasks.parquet, meta/stats.json and README.md.

    `info` holds the fields of lerobot's DatasetInfo that are not at their defaults. Raises
    MissingLerobot.
    """
    import pandas as pd

    _, io_utils, utils = require_lerobot()
    dataset = utils.DatasetInfo.from_dict(
        {**info, "features": {name: dict(f) for name, f in info["features"].items()}}
    )
    (root / "meta").mkdir(parents=True, exist_ok=True)
    io_utils.write_info(dataset, root)
    io_utils.write_tasks(
        pd.DataFrame({"task_index": range(len(tasks))}, index=pd.Index(tasks, name="task")), root
    )
    io_utils.write_stats(dict(stats), root)
    write_card(root, description, info["total_frames"], dataset)


def write_card(root: Path, description: str, frames: int, dataset: Any = None) -> None:
    """README.md, whose front matter tells the hub and `load_dataset` where the data are; `dataset`
    is a DatasetInfo to show.

    Raises MissingLerobot.
    """
    _, _, utils = require_lerobot()
    card = utils.create_lerobot_dataset_card(
        tags=list(TAGS),
        dataset_info=dataset,
        license=LICENSE,
        paper=PAPER,
        url=PAPER,
        dataset_description=description,
    )
    card.data.size_categories = [size_category(frames)]
    (root / "README.md").write_text(str(card))
