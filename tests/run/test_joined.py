"""Exports of several datasets."""

import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.export import EXPORTERS, ExportError, Job
from pipeline.run.export import Request, export
from pipeline.run.joined import DatasetPart, join
from tests.synthetic import episode_path, make_episode

TABLE = "meta/domino_episodes.parquet"


def parts(tmp_path, counts):
    out = []
    for name, count in counts.items():
        root = tmp_path / name
        paths = [
            make_episode(episode_path(root, slot=i), slot=i, seed=i, frames=4) for i in range(count)
        ]
        out.append(DatasetPart(Dataset(root), paths))
    return out


def test_several_datasets_become_one_that_names_the_source_of_each_episode(tmp_path):
    origins = join(parts(tmp_path, {"bells": 4, "more": 2}), tmp_path / "joined")
    for name in ("lerobot", "rlds", "zarr"):
        exporter, out = EXPORTERS[name], tmp_path / name
        given_too = {"datasets": 2}
        exporter.export(
            Job(
                tmp_path / "joined",
                out,
                list(origins),
                exporter.options(),
                origins=origins,
                given=given_too,
            )
        )
        table = next(p for p in (out / TABLE, *out.rglob("episodes.parquet")) if p.is_file())
        assert pq.read_table(table)["dataset"].to_pylist() == ["bells"] * 4 + ["more"] * 2
    columns = pq.read_table(tmp_path / "lerobot/meta/episodes")
    assert columns["domino.dataset"].to_pylist() == ["bells"] * 4 + ["more"] * 2


def test_what_cannot_be_joined_is_one_line(built, tmp_path):
    source = Dataset(built)
    for request, said in (
        (Request("lerobot", also=[source]), "several datasets need --out"),
        (Request("aloha", out=tmp_path / "x", also=[source]), "aloha holds one dataset"),
        (Request("zarr", out=tmp_path / "x", also=[source]), "two datasets have the name"),
    ):
        with pytest.raises(ExportError, match=said):
            export(source, request)
    assert not (tmp_path / "x").exists()
