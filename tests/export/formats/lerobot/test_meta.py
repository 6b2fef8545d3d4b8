"""What describes a LeRobot dataset against lerobot's own functions."""

from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.export.formats.lerobot import meta


def test_what_describes_a_dataset_has_the_bytes_that_lerobot_writes(tmp_path):
    """Schema, info.json, tasks and statistics by our functions and by lerobot's."""
    pytest.importorskip("lerobot")
    feature_utils, io_utils, utils = (
        import_module(f"lerobot.datasets.{name}") for name in ("feature_utils", "io_utils", "utils")
    )

    kinds = {"wide": ("float32", [7]), "one": ("float32", [1]), "text": ("string", [1])}
    kinds |= {"count": ("int64", [1]), "film": ("video", [4, 6, 3])}
    features = {
        name: {"dtype": kind, "shape": shape, "names": ["é"]}
        for name, (kind, shape) in kinds.items()
    }
    shaped = {name: {**f, "shape": tuple(f["shape"])} for name, f in features.items()}
    schema = feature_utils.get_hf_features_from_features(shaped).arrow_schema
    assert meta.data_schema(features).serialize() == schema.serialize()

    info: dict[str, Any] = {
        "codebase_version": "v3.0",
        "fps": 15,
        "features": features,
        "robot_type": "aloha",
    }
    info |= {"total_episodes": 2, "total_frames": 5000, "total_tasks": 2}
    info |= {"data_files_size_in_mb": 7, "video_files_size_in_mb": 9, "splits": {"train": "0:2"}}
    tasks = ["pick it", "ein Gerät"]
    stats = {"wide": {"min": np.arange(3, dtype=np.float32) / 3, "count": np.array([3])}}
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    meta.write_meta(ours, info, tasks, stats)
    dataset = utils.DatasetInfo.from_dict({**info, "features": shaped})
    io_utils.write_info(dataset, theirs)
    io_utils.write_stats(stats, theirs)
    index = pd.Index(tasks, name="task")
    io_utils.write_tasks(pd.DataFrame({"task_index": range(2)}, index=index), theirs)
    for name in ("meta/info.json", "meta/stats.json"):
        assert (ours / name).read_text() == (theirs / name).read_text(), name
    assert pd.read_parquet(ours / "meta/tasks.parquet").equals(io_utils.load_tasks(theirs))
