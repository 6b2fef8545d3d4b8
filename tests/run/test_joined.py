"""Exports at another rate and of several datasets."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.export import EXPORTERS, ExportError, Job
from pipeline.run.export import Request, differences, export
from pipeline.run.joined import DatasetPart, join, weigh
from tests.synthetic import episode_path, make_episode

TABLE = "meta/domino_episodes.parquet"


def test_an_export_at_a_third_of_the_rate_keeps_every_third_frame(built, tmp_path):
    source = Dataset(built)
    made = {
        fps: export(source, Request("lerobot", out=tmp_path / str(fps), where="level=2", fps=fps))
        for fps in (None, 5)
    }
    tables = {fps: pq.read_table(one.place / "data").to_pydict() for fps, one in made.items()}
    rows = [i for i, frame in enumerate(tables[None]["frame_index"]) if frame % 3 == 0]
    for column in ("observation.state", "target.pose", "ee.pose"):
        assert tables[5][column] == [tables[None][column][i] for i in rows]
    assert json.loads((made[5].place / "meta/info.json").read_text())["fps"] == 5
    assert not differences(source, made[5].place)
    with pytest.raises(ExportError, match="--fps 7: 7 frames a second do not divide 240"):
        export(source, Request("lerobot", out=tmp_path / "7", fps=7))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["5", "None"]


def test_images_between_frames_are_drawn(built, tmp_path):
    source = Dataset(built)
    [path, *_] = source.accepted(source.recipe())
    [place] = join([DatasetPart(source, [path])], tmp_path, 30)
    with open_episode(path) as old, open_episode(place) as new:
        assert len(new) == 2 * len(old) - 1
        camera = new.cameras[0]
        drawn, stored = (list(file.frames(camera)) for file in (new, old))
        assert all(np.array_equal(a, b) for a, b in zip(drawn[::2], stored, strict=True))
        moving = int(np.argmax(np.abs(np.diff(old.read().log.qpos, axis=0)).sum(1)))
        assert not np.array_equal(drawn[2 * moving + 1], drawn[2 * moving])


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
    given = parts(tmp_path, {"bells": 4, "more": 6})
    weighed = weigh(given, [1, 0.5])
    assert [len(part.episodes) for part in weighed] == [4, 2]
    assert set(weigh(given, [1, 1])[1].episodes) > set(weighed[1].episodes)
    origins = join(weighed, tmp_path / "joined", None)
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


def test_weights_hold_for_each_robot(tmp_path):
    given = []
    for name, counts in {"a": (6, 2), "b": (4, 4), "c": (4, 0)}.items():
        root, paths = tmp_path / name, []
        for robot, count in zip(("aloha-agilex", "franka-panda"), counts, strict=True):
            paths += [
                make_episode(
                    episode_path(root, robot, i), embodiment=robot, slot=i, seed=i, frames=2
                )
                for i in range(count)
            ]
        given.append(DatasetPart(Dataset(root), paths))
    weighed = weigh(given[:2], [1, 1])
    robots = [[path.relative_to(p.dataset.root).parts[2] for path in p.episodes] for p in weighed]
    assert robots == [["aloha-agilex"] * 4 + ["franka-panda"] * 2] * 2
    with pytest.raises(ExportError, match="c has no franka-panda"):
        weigh(given[1:], [1, 1])


def test_what_cannot_be_joined_is_one_line(built, tmp_path):
    source = Dataset(built)
    for request, said in (
        (Request("lerobot", also=[source]), "several datasets need --out"),
        (Request("aloha", out=tmp_path / "x", also=[source]), "aloha holds one dataset"),
        (Request("zarr", out=tmp_path / "x", also=[source]), "two datasets have the name"),
        (Request("zarr", out=tmp_path / "x", weights=[1, 2]), "2 numbers for 1 datasets"),
        (Request("zarr", out=tmp_path / "x", weights=[0]), "--weights: each must be above 0"),
    ):
        with pytest.raises(ExportError, match=said):
            export(source, request)
    assert not (tmp_path / "x").exists()
