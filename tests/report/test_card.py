"""The card of every kind of export against the data it is made of, and every snippet that it shows,
run."""

import importlib.util
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.slots.select import position_of, split_of
from pipeline.export import EXPORTERS, Job
from pipeline.export.shared.record import read_card
from pipeline.html import table
from pipeline.report.card import describe
from pipeline.report.card.plots import _edges
from pipeline.report.card.survey import cameras, look, visibility
from pipeline.report.card.text import spread
from tests.export.running import REQUIRED
from tests.synthetic import episode_path, make_episode

FAILED = {"attempt": 0, "stage": "replay", "reason": "missed", "conditions": ["held"]}
ROBOTS = ("aloha-agilex", "franka-panda")


@dataclass(frozen=True)
class Kind:
    """One kind of card: its format, robots, options, and whether it is of failed attempts."""

    format: str
    robots: tuple[str, ...] = ROBOTS[:1]
    options: tuple[tuple[str, Any], ...] = ()
    split: str = "episodes"


KINDS = {
    name: Kind(name)
    for name in ("lerobot", "lerobot-v2.1", "parquet", "aloha", "robotwin", "dynamicwam", "puma-gt")
}
ONE = [
    "lerobot",
    "parquet",
    "aloha",
    "robotwin",
    "puma-gt",
    "xpolicylab",
    "zarr",
    "robomimic",
    "rlds",
]
KINDS |= {name: Kind(name) for name in ONE}
HEADS = {
    "robotwin": "head_camera",
    "puma-gt": "head_camera",
    "xpolicylab": "cam_head",
    "zarr": "img",
}
"""What the head camera is called if not cam_high."""
KINDS |= {f"{name}, several robots": Kind(name, ROBOTS) for name in ("lerobot", "parquet", "aloha")}
KINDS |= {"lerobot, per task": Kind("lerobot", options=(("per_task", True),))}
KINDS |= {f"{name}, failures": Kind(name, split="failures") for name in ("lerobot", "aloha")}


@dataclass(frozen=True)
class Made:
    """A card: front matter, text, directory."""

    front: dict[str, Any]
    text: str
    out: Path

    @property
    def codes(self) -> list[str]:
        return [
            code.replace("DIR", str(self.out))
            for code in re.findall(r"```python\n(.*?)```", self.text, re.S)
        ]


@pytest.fixture(scope="module")
def card(tmp_path_factory):
    """A function that makes the card of a kind, once."""
    root, made = tmp_path_factory.mktemp("carded"), {}

    def episodes(kind: Kind) -> list[Path]:
        home = root / kind.split
        paths = []
        for robot in kind.robots:
            for i in range(2):
                path = episode_path(home, robot, slot=i, level=1 + i)
                meta = {"physics_id": f"{robot}{i}"} | (
                    {"failure": FAILED} if kind.split == "failures" else {}
                )
                given = {
                    "embodiment": robot,
                    "slot": i,
                    "seed": i,
                    "level": 1 + i,
                    "frames": 6 + i,
                    "meta": meta,
                }
                paths.append(path if path.exists() else make_episode(path, **given))
        return paths

    def make(name: str) -> Made:
        if name not in made:
            kind, out = KINDS[name], root / "exports" / name.replace(", ", "-").replace(" ", "-")
            paths = episodes(kind)
            options = EXPORTERS[kind.format].options(
                **REQUIRED.get(kind.format, {}), **dict(kind.options)
            )
            job = Job(
                root / kind.split,
                out,
                paths,
                options,
                describe=describe(root / kind.split, paths),
                split=kind.split,
            )
            EXPORTERS[kind.format].export(job)
            made[name] = Made(*read_card(out / "README.md"), out)
        return made[name]

    return make


@pytest.mark.parametrize("name", ONE)
def test_a_card_says_what_the_hub_and_a_reviewer_ask(card, name):
    front, text, out = card(name).front, card(name).text, card(name).out
    assert (
        front["license"] == "apache-2.0"
        and "robotics" in front["task_categories"]
        and front["size_categories"] == ["n<1K"]
    )
    assert ("configs" in front) == (name in ("lerobot", "parquet"))
    assert text.startswith("# Dynamic manipulation: click bell, aloha-agilex\n")
    assert "2 simulated episodes, 13 frames at 15 Hz" in text
    assert "| click_bell | aloha-agilex | 2 | 0.1 | clean | 1 |  | 0.5 (0.5 to 0.5) |" in text
    camera = HEADS.get(name, "cam_high")
    # f = 120 / tan(18.5 degrees)
    assert f"| {camera} | 320 x 240 | 37 | 358.6 | fixed in the world | aloha-agilex |" in text
    asked = {
        "Intended use",
        "What is in it",
        "How to load it",
        "Splits",
        "How it was made",
        "Known limits",
        "Citation",
    }
    assert asked <= set(re.findall(r"^## (.*)$", text, re.M))
    for image in re.findall(r"(?:\(|src=\")(card/[^)\"]+)", text):
        assert (out / image).stat().st_size > 500


@pytest.mark.parametrize("name", KINDS)
def test_every_snippet_runs(card, name, tmp_path, monkeypatch):
    codes = card(name).codes
    assert len(codes) >= 2
    datasets = importlib.import_module("datasets")
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path)
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)
    for code in codes:
        # these two are run in environments of their own, by benchmarks/consumers
        if re.search("^import (zarr|tensorflow_datasets)", code, re.M):
            continue
        known: dict[str, Any] = {}
        exec(code, known)
        if "episodes=train" in code:
            assert (
                known["data"].num_episodes
                == len(known["train"])
                == (1 if "per task" in name else 2)
            )


def test_the_card_of_failures_shows_no_demonstrations(card):
    text, front = card("lerobot, failures").text, card("lerobot, failures").front
    assert (
        text.startswith("# Dynamic manipulation, failed attempts: ")
        and "\n2 failed attempts, 13 frames" in text
    )
    assert (
        "not demonstrations" in text
        and "Demonstrations come from" not in text
        and "are left out" not in text
    )
    assert (
        "| replay | missed | 2 |" in text
        and "failed attempts" in card("aloha, failures").front["pretty_name"]
    )
    assert front["license"] == "apache-2.0"


@pytest.mark.parametrize(
    ("corrected", "meta"), [(0, {}), (0, {"expert": "reactive"}), (3, {"corrects": "static@1"})]
)
def test_a_card_says_what_its_experts_know_and_which_frames_are_a_policys(
    tmp_path, corrected, meta
):
    path = make_episode(
        episode_path(tmp_path), frames=6, corrected=corrected, meta=meta | {"physics_id": "a"}
    )
    out = tmp_path / "out"
    EXPORTERS["parquet"].export(
        Job(
            tmp_path,
            out,
            [path],
            EXPORTERS["parquet"].options(),
            describe=describe(tmp_path, [path]),
        )
    )
    text = (out / "README.md").read_text()
    assert ("know the target's motion in advance" in text) == (meta == {})
    assert ("nothing of its future but which arm is to act" in text) == (meta != {})
    assert ("`intervention` is false" in text) == ("static@1" in text) == (corrected > 0)
    assert ("`action` where `intervention`" in text) == (corrected > 0)


def test_several_robots_are_several_datasets(card):
    made = card("lerobot, several robots")
    assert [config["config_name"] for config in made.front["configs"]] == list(ROBOTS)
    assert "It holds 2 LeRobot datasets" in made.text and "- `franka-panda`\n" in made.text
    assert (
        "| cam_high | 320 x 240 | 37 | 358.6 | fixed in the world | aloha-agilex, franka-panda |"
        in made.text
    )


def test_a_camera_that_robots_carry_on_other_links_has_a_row_for_each(tmp_path):
    seen = []
    for robot, link in zip(ROBOTS, ("left_link6", "left_panda_hand"), strict=True):
        one = look(make_episode(episode_path(tmp_path, robot), embodiment=robot))
        info = one.meta.drawing.cameras["head_camera"].model_copy(update={"link": link})
        drawing = one.meta.drawing.model_copy(
            update={"cameras": dict(one.meta.drawing.cameras) | {"head_camera": info}}
        )
        seen.append(replace(one, meta=one.meta.model_copy(update={"drawing": drawing})))
    rows = cameras([*seen, seen[0]], {"format": "robotwin", "options": {}})
    for robot, link in zip(ROBOTS, ("left_link6", "left_panda_hand"), strict=True):
        assert rows.count(f"| {link} | {robot} |") == 1


def test_a_card_tells_how_much_of_the_target_is_visible(tmp_path):
    one = look(make_episode(episode_path(tmp_path), frames=12))
    assert one.visible == {} and visibility([one], {"head_camera": "cam_high"}) == ""
    parts = [
        (0.9, (0.9, 0.9, 0.9)),
        (0.5, (0.1, 0.2, 0.9)),
        (0.1, (0.0, 0.1, 0.2)),
        (0.1, (0.2, 0.2, 0.2)),
    ]
    seen = [
        replace(
            one,
            visible={"head_camera": np.full(5, share)},
            last_visible={"head_camera": np.array(last)},
        )
        for share, last in parts
    ]
    text = visibility(seen, {"head_camera": "cam_high", "left_camera": "cam_left_wrist"})
    assert "| cam_high | 10 | 30 | 90 | 50 | 75 |" in text and "cam_left_wrist" not in text


def test_splits_follow_physics_and_nothing_else(card):
    # sha256("a") begins with ca97..., 0x19 = 25 of 256 begins the train split after 20 %
    assert position_of("a") == pytest.approx(0xCA978112CA1BBDCA / 2**64)
    ids = [f"physics{i}" for i in range(2000)]
    shares = {
        split: np.mean([split_of(one) == split for one in ids])
        for split in ("train", "validation", "test")
    }
    assert shares["train"] == pytest.approx(0.8, abs=0.03) and shares[
        "validation"
    ] == pytest.approx(0.1, abs=0.02)
    for name, file in (("aloha", "episodes.parquet"), ("lerobot", "meta/domino_episodes.parquet")):
        rows = pq.read_table(card(name).out / file).to_pylist()
        assert [row["split"] for row in rows] == [split_of(row["physics_id"]) for row in rows]
    episodes = pq.read_table(card("lerobot").out / "meta/episodes/chunk-000/file-000.parquet")
    assert set(episodes["domino.split"].to_pylist()) == {"train"}


def test_one_identifier_for_all_formats_of_the_same_physics(card):
    found = {name: re.findall("identifier ([0-9a-f]{16})", card(name).text) for name in KINDS}
    assert len({found[name][0] for name in ONE}) == 1
    assert found["aloha"] != found["aloha, several robots"]


def test_the_same_episodes_give_the_same_plots(card):
    assert len({(card(name).out / "card" / "plots.png").read_bytes() for name in ONE}) == 1


def test_tables_and_choices():
    assert table("a", [["x|y"]]) == "| a |\n| --- |\n| x&#124;y |\n\n"
    assert spread([*map(Path, "abcdefghi")], 3) == [*map(Path, "aei")] and spread(
        [Path("a")], 3
    ) == [Path("a")]


def test_speeds_that_differ_by_rounding_only_are_plotted():
    edges = _edges([[0.05, np.nextafter(0.05, 1)], [0.05]])
    assert len(edges) == 21 and edges[0] < 0.03 and edges[-1] > 0.07
    np.testing.assert_allclose(_edges([[1.0, 2.0], [4.0]]), np.linspace(1, 4, 21))


def test_what_a_dataset_says_of_itself_is_text_on_its_card(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=3)
    hostile = "<img src=x onerror=alert(1)>\x1b[31m [a](javascript:1) ``` | b"
    made = {"renderer": hostile, "processor": hostile, "packages": {hostile: hostile}}
    (tmp_path / "provenance.json").write_text(json.dumps(made))
    (tmp_path / "manifest.yaml").write_text(
        "name: x # " + hostile.replace("\x1b", "") + "\n```\n<script>\n\x1b[2J\n````\n<b>\n"
    )
    exporter = EXPORTERS["puma-gt"]
    exporter.export(
        Job(
            tmp_path,
            tmp_path / "out",
            [path],
            exporter.options(),
            describe=describe(tmp_path, [path]),
        )
    )
    text = (tmp_path / "out" / "README.md").read_text()
    assert all(c.isprintable() or c == "\n" for c in text)
    blocks = re.compile(r"^(`{3,})\w*\n.*?^\1$", re.S | re.M)
    recipe = next(block[0] for block in blocks.finditer(text) if "<script>" in block[0])
    assert "<b>" in recipe and recipe.startswith("`````yaml\n")
    outside = blocks.sub("", text)
    assert (
        "&lt;img src=x" in outside
        and "<img" not in outside
        and "](javascript" not in outside
        and "<b>" not in outside
    )
    rows = [line for line in outside.splitlines() if "onerror" in line]
    assert len(rows) == 3 and all(len(row.split("|")) == 4 for row in rows)
