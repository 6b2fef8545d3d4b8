"""`--embodiment` and `--where`: what is exported, what export.json remembers, and facts of an
episode beside its spec."""

import json
from dataclasses import asdict
from functools import partial

import h5py
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.slots.records import ATTEMPTS, PLACE
from pipeline.data.slots.select import (
    COLUMNS,
    WhereError,
    attempts_of,
    columns_of,
    expression,
    position_of,
    split_of,
)
from pipeline.export import EXPORTERS, ExportError, Job
from pipeline.export.shared.episodes import select_episodes
from pipeline.export.shared.record import read_record
from tests.synthetic import episode_path, make_episode


@pytest.fixture
def episodes(tmp_path):
    """Two levels of a robot of 14 joints and one episode of a robot of 16."""
    made = [("aloha-agilex", 1), ("aloha-agilex", 2), ("franka-panda", 1)]
    return [
        make_episode(
            episode_path(tmp_path, name, level=level), embodiment=name, level=level, frames=3
        )
        for name, level in made
    ]


@pytest.mark.parametrize(
    ("where", "robots", "chosen"),
    [
        (None, [], [0, 1, 2]),
        (None, ["aloha-agilex"], [0, 1]),
        ("level=1", [], [0, 2]),
        ("level=1 or level=2", ["franka-panda"], [2]),
    ],
)
def test_robots_and_expressions_select_together(episodes, where, robots, chosen):
    assert select_episodes(episodes, expression(where, robots)) == [episodes[i] for i in chosen]


def test_a_selection_that_cannot_be_is_one_line(episodes):
    with pytest.raises(WhereError, match="--where 'level=': cannot be read: join tests"):
        expression("level=", ["aloha-agilex"])
    with pytest.raises(ExportError, match="no episode fits --where 'level=3'"):
        select_episodes(episodes, "level=3")
    with pytest.raises(WhereError, match="--where ' ': is empty"):
        expression(" ", [])
    with pytest.raises(ExportError, match="embodiment is aloha-agilex or franka-panda"):
        select_episodes(episodes, "embodiment=aloha")
    with pytest.raises(ExportError, match=r"none has arm$"):
        select_episodes(episodes, "arm=control")


def test_a_format_of_14_joints_takes_the_robots_that_have_them(episodes, tmp_path):
    exporter, out, where = (
        EXPORTERS["dynamicwam"],
        tmp_path / "out",
        expression(None, ["aloha-agilex"]),
    )
    with pytest.raises(ExportError, match=r"franka-panda are not 14 wide.*with --embodiment"):
        exporter.export(Job(tmp_path, out, episodes, exporter.options()))
    chosen = select_episodes(episodes, where)
    exporter.export(Job(tmp_path, out, chosen, exporter.options(), where=where))
    assert json.loads((out / "export.json").read_text())["where"] == where


def test_speeds_the_meeting_and_the_split_select_too(tmp_path):
    paths = []
    for slot in range(12):
        meta = {"average_speed": 0.01 * slot, "meeting_time": 0.1 * slot, "physics_id": str(slot)}
        paths.append(
            make_episode(episode_path(tmp_path, slot=slot), slot=slot, frames=2, meta=meta)
        )
    assert select_episodes(paths, "average_speed > 0.085") == paths[9:]
    assert select_episodes(paths, "T_meet <= 0.25 and average_speed > 0") == paths[1:3]
    for share in (0.1, 0.5):
        held = [
            path
            for path, slot in zip(paths, range(12), strict=True)
            if position_of(str(slot)) < share
        ]
        assert 0 < len(held) < 12 and select_episodes(paths, "split=validation", share) == held


def test_what_the_index_and_the_record_of_an_episode_hold_selects(tmp_path):
    dataset = Dataset(tmp_path)
    failed = {"attempt": 0, "stage": "replay", "reason": "dropped", "detail": "", "conditions": []}
    paths = [
        make_episode(
            episode_path(tmp_path, slot=slot), slot=slot, seed=slot, frames=2 + slot, meta=meta
        )
        for slot, meta in enumerate(
            ({}, {"end_speed": 0.2, "expert": "reactive"}, {"failure": failed})
        )
    ]
    with open_episode(paths[1]) as file:
        spec = asdict(file.spec)
        of_attempt = {"attempt", "stage", "reason", "detail", "sim_steps", "seconds"}
        assert columns_of(file, {}).keys() == COLUMNS.keys() - of_attempt
    row = {name: spec[name] for name in (*PLACE, "seed")}
    row |= {"attempt": 3, "outcome": "accepted", "seconds": 2.5, "sim_steps": 700}
    rows = [{name: row.get(name) for name in ATTEMPTS.names}]
    pq.write_table(pa.Table.from_pylist(rows, ATTEMPTS), dataset.attempts)

    def chosen(where):
        return select_episodes(paths, where, attempts=partial(attempts_of, dataset.attempt_rows))

    assert chosen("attempt = 3") == chosen("seconds > 2 and sim_steps=700") == [paths[1]]
    assert chosen("end_speed > 0.1") == chosen("expert = reactive") == [paths[1]]
    assert chosen("outcome = failed") == chosen("reason = dropped") == [paths[2]]
    assert chosen("length >= 3 and outcome = accepted") == [paths[1]]
    assert chosen("category in (interception, tracking) and rules = strict") == paths


@pytest.mark.parametrize("format", ["parquet", "robomimic", "lerobot"])
def test_the_share_of_the_validation_split_is_that_of_the_export(tmp_path, format):
    paths = []
    for slot in range(4):
        path = episode_path(tmp_path, slot=slot)
        paths.append(
            make_episode(
                path, slot=slot, frames=2, cameras=("head_camera",), meta={"physics_id": str(slot)}
            )
        )
    exporter, out = EXPORTERS[format], tmp_path / "out"
    exporter.export(Job(tmp_path, out, paths, exporter.options(), validation=0.4))
    wanted = [split_of(str(slot), 0.4) for slot in range(4)]
    assert [split == "validation" for split in wanted] == [
        position_of(str(slot)) < 0.4 for slot in range(4)
    ]
    assert wanted != [split_of(str(slot)) for slot in range(4)]
    rows = pq.read_table(next(out.rglob("*episodes.parquet"))).to_pylist()
    assert [row["split"] for row in rows] == wanted and read_record(out).summary[
        "validation"
    ] == 0.4
    if format == "lerobot":
        assert (
            pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet")[
                "domino.split"
            ].to_pylist()
            == wanted
        )
    if format == "robomimic":
        with h5py.File(out / "demos.hdf5") as f:
            assert f["mask/valid"][()].tolist() == [
                f"demo_{i}".encode() for i, split in enumerate(wanted) if split == "validation"
            ]
