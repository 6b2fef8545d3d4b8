"""Columns of the origin that only some exports have."""

import json

import pyarrow.parquet as pq
import pytest

from tests.export.running import run
from tests.synthetic import episode_path, make_episode

FILES = {"lerobot": ("meta/episodes", "domino."), "parquet": (".", "")}


@pytest.mark.parametrize("format", FILES)
def test_what_is_asked_for_is_a_column_where_a_task_has_choices(format, tmp_path):
    folder, prefix = FILES[format]
    paths = [
        make_episode(
            episode_path(tmp_path, task=task), task=task, frames=4, meta={"choices": choices}
        )
        for task, choices in (("click_bell", {}), ("pick_named", {"choice": "red"}))
    ]
    run(format, tmp_path, tmp_path / "both", paths)
    run(format, tmp_path, tmp_path / "plain", paths[:1])
    both, plain = (
        pq.read_table(
            next(p for p in (tmp_path / out / folder).rglob("*.parquet") if "episode" in str(p))
        )
        for out in ("both", "plain")
    )
    asked = [json.loads(text) for text in both[f"{prefix}choices"].to_pylist()]
    assert asked == [{}, {"choice": "red"}]
    assert f"{prefix}choices" not in plain.column_names
