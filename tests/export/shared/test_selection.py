"""`--embodiment` and `--where`: what is exported, what export.json remembers, and that verify compares the same episodes."""

import json

import pytest

from pipeline.data.select import WhereError
from pipeline.export import EXPORTERS, ExportError, Job
from pipeline.export.shared.episodes import expression, select_episodes
from tests.synthetic import episode_path, make_episode


@pytest.fixture
def episodes(tmp_path):
    """Two levels of a robot of 14 joints and one episode of a robot of 16."""
    made = [("aloha-agilex", 1), ("aloha-agilex", 2), ("franka-panda", 1)]
    return [make_episode(episode_path(tmp_path, name, level=level), embodiment=name, level=level, frames=3) for name, level in made]


@pytest.mark.parametrize(
    ("where", "robots", "chosen"),
    [
        (None, [], [0, 1, 2]),
        ("  ", ["aloha-agilex"], [0, 1]),
        ("level=1", [], [0, 2]),
        ("level=1 or level=2", ["franka-panda"], [2]),
    ],
)
def test_robots_and_expressions_select_together(episodes, where, robots, chosen):
    assert select_episodes(episodes, expression(where, robots)) == [episodes[i] for i in chosen]


def test_a_selection_that_cannot_be_is_one_line(episodes):
    with pytest.raises(WhereError, match="--where 'level=': ends where something should follow"):
        expression("level=", ["aloha-agilex"])
    with pytest.raises(ExportError, match="no episode fits --where 'level=3'"):
        select_episodes(episodes, "level=3")


def test_a_format_of_14_joints_takes_the_robots_that_have_them(episodes, tmp_path):
    exporter, out, where = EXPORTERS["dynamicwam"], tmp_path / "out", expression(None, ["aloha-agilex"])
    with pytest.raises(ExportError, match=r"franka-panda are not 14 wide.*with --embodiment"):
        exporter.export(Job(tmp_path, out, episodes, exporter.options()))
    chosen = select_episodes(episodes, where)
    exporter.export(Job(tmp_path, out, chosen, exporter.options(), where=where))
    assert json.loads((out / "export.json").read_text())["where"] == where
