"""The report and the contact sheet against episodes of known numbers and colours."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from jinja2 import UndefinedError

from pipeline.data.atomic import write_atomic
from pipeline.data.cameras import CAMERA_TYPES, Camera
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.frames import decode_frame
from pipeline.data.recipe.model import Cell
from pipeline.data.slots.records import ATTEMPTS
from pipeline.html import render_page
from pipeline.report import page as report_page
from pipeline.report.film_strip import (
    GAP,
    MEETING_COLOR,
    TITLE,
    contact_sheet,
    draw_path,
    film,
    path_pixels,
    pick_frames,
)
from pipeline.report.page import Figure, write_report
from pipeline.report.summary import EpisodeFacts, Group, speed_histogram
from tests.synthetic import COLORS, HALF, SPEED, episode_path, make_episode, square_corner


def attempt(**changes) -> dict:
    row = {
        "task": "click_bell",
        "embodiment": "aloha-agilex",
        "level": 1,
        "alpha": 0.1,
        "domain": "clean",
        "slot": 0,
        "attempt": 0,
        "seed": 1,
        "outcome": "accepted",
        "stage": "render",
        "reason": "",
        "sim_steps": 500,
        "seconds": 1.5,
    }
    return row | changes


def report(root, paths, rows, sheets=(), keys=None):
    """The report of some episodes and attempts."""
    seen, tried = {}, {}
    for path in paths:
        with open_episode(path) as e:
            spec, seconds = vars(e.spec), len(e) / e.fps
        cell = Cell(*(spec[name] for name in Cell.__match_args__))
        seen.setdefault(cell, []).append(EpisodeFacts(path, seconds, SPEED, SPEED))
    for row in rows:
        tried.setdefault(Cell(*(row[name] for name in Cell.__match_args__)), []).append(row)
    groups = [
        Group(cell, seen.get(cell, ()), pa.Table.from_pylist(tried.get(cell, []), ATTEMPTS))
        for cell in sorted({*seen, *tried})
    ]
    return write_report(root, groups, sheets, keys)


class Tags(HTMLParser):
    """Collects tags and checks that they nest."""

    VOID = frozenset({"meta", "img"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag, attrs) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs) -> None:
        self.seen.append((tag, dict(attrs)))

    def handle_endtag(self, tag) -> None:
        assert self.open.pop() == tag


def parse(text: str) -> Tags:
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    return tags


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> tuple[Path, list[Path], str]:
    root = tmp_path_factory.mktemp("a <dataset>")
    paths = [
        make_episode(episode_path(root, level=n, slot=s), level=n, slot=s, seed=s, frames=30)
        for n in (0, 1, 2)
        for s in (0, 1)
    ]
    rows = [attempt(level=n, slot=s) for n in (0, 1, 2) for s in (0, 1)]
    rows += [attempt(outcome="failed", stage="replay", reason="missed<b>", attempt=1)] * 3
    rows += [attempt(level=3, outcome="failed", stage="dry_run", reason="no_plan")] * 4
    page = report(root, paths, rows, [Figure(b"jpeg", "overlay")])
    assert page == root / "report" / "index.html"
    return root, paths, page.read_text(encoding="utf-8")


def test_the_report_is_one_wellformed_file_without_outside_references(dataset):
    root, _, text = dataset
    tags = parse(text)
    assert [p.name for p in (root / "report").iterdir()] == ["index.html"]
    for tag, attrs in tags.seen:
        assert tag not in ("script", "link", "iframe")
        assert tag != "img" or (attrs["src"] or "").startswith("data:image/jpeg;base64,")
        assert (attrs.get("href") or "#").startswith("#")
    assert "http" not in text and "url(" not in text and "@import" not in text


def test_every_link_of_the_contents_has_its_section(dataset):
    tags = parse(dataset[2])
    ids = {attrs["id"] for _, attrs in tags.seen if "id" in attrs}
    links = {attrs["href"][1:] for tag, attrs in tags.seen if tag == "a" and attrs["href"]}
    assert links and links <= ids and "annotations" in ids


def test_tiles_and_bars_state_the_counts(dataset):
    text = dataset[2]
    assert "<b>6</b><span>episodes" in text and "<b>13</b><span>attempts" in text
    assert (
        f"<b>{100 * 6 / 13:.1f} %</b>" in text
        and "<b>6,500</b><span>physics steps" in text
        and "<b>19.5 s</b>" in text
    )
    assert "<b>3.25 s</b><span>spent an episode" in text
    assert "<b>0.2 min</b>" in text  # 6 episodes of 30 frames at 15 Hz are 12 s
    assert (
        re.search(r"replay: missed&lt;b&gt;</span><div><i[^>]*></i>3<", text)
        and "missed<b>" not in text
    )
    assert re.search(r"dry run: no plan</span><div><i[^>]*></i>4<", text)
    assert text.count("No episode was accepted.") == 1  # the level 3 cell


def test_pictures_are_jpeg_with_one_meeting_a_film(dataset):
    tags = parse(dataset[2])
    images = [attrs["src"] or "" for tag, attrs in tags.seen if tag == "img"]
    assert len(images) == 1 + 6 * 6
    assert base64.b64decode(images[0].split(",", 1)[1]) == b"jpeg"
    for source in images[1:7]:
        data = base64.b64decode(source.split(",", 1)[1])
        assert decode_frame(data).shape == (192, 256, 3)
    assert sum(attrs.get("class") == "meeting" for _, attrs in tags.seen) == 6


def test_a_dataset_without_attempts_or_episodes_still_reports(tmp_path):
    text = report(tmp_path, [], []).read_text()
    parse(text)
    assert "No attempts are recorded." in text and "Nothing moves in this dataset." in text


def test_many_cells_have_a_page_for_each_task_that_is_drawn_again_when_it_changed(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(report_page, "MANY_CELLS", 3)
    tasks = ("click_bell", "grab_roller")
    paths = [
        make_episode(episode_path(tmp_path, task=t, slot=s), task=t, slot=s, seed=s, frames=3)
        for t in tasks
        for s in (0, 1)
    ]
    rows = [
        attempt(task=t, level=n, slot=s, seconds=2.0) for t in tasks for n in (1, 2) for s in (0, 1)
    ]
    page = report(tmp_path, paths, rows, keys=dict.fromkeys(tasks, "a"))
    text, pages = page.read_text(), sorted((tmp_path / "report" / "tasks").iterdir())
    assert [p.name for p in pages] == ["click_bell.html", "grab_roller.html"]
    assert (
        '<a href="tasks/grab_roller.html">grab roller</a></td><td>2</td><td>4</td><td>4</td>'
        in text
    )
    assert "<img" not in text and "<b>8</b><span>attempts" in text
    # three frames of one episode
    assert [parse(p.read_text()).seen and p.read_text().count("<img") for p in pages] == [3, 3]
    assert "<b>4</b><span>attempts" in pages[0].read_text()
    before = [p.stat().st_mtime_ns for p in pages]
    report(tmp_path, paths, rows, keys={"click_bell": "a", "grab_roller": "b"})
    assert [p.stat().st_mtime_ns == old for p, old in zip(pages, before, strict=True)] == [
        True,
        False,
    ]
    monkeypatch.setattr(report_page, "MANY_CELLS", 40)
    report(tmp_path, paths, rows)
    assert not pages[0].exists() and page.read_text().count("<img") == 4 * 3


def test_a_broken_episode_is_named_on_its_card(tmp_path):
    path = tmp_path / "episode_0000000.hdf5"
    path.write_bytes(b"not hdf5")
    group = Group(Cell("click_bell", "aloha", 1, 0.1, "clean"), [EpisodeFacts(path, 1.0, 0.1, 0.1)])
    assert "No frames: " + str(path) in write_report(tmp_path, [group]).read_text()


def test_a_histogram_counts_speeds_up_to_a_little_above_the_largest():
    speeds = [(0.05, 0.2), (0.05, 0.2), (0.05, 0.2), (0.10, 0.2)]
    h = speed_histogram([EpisodeFacts(Path(), 1.0, *each) for each in speeds], alpha=0.1, bins=10)
    assert h["average"] == [0, 0, 3, 0, 1, 0, 0, 0, 0, 0] and h["maximum"] == [0] * 9 + [4]
    assert (h["top"], h["mean"], h["largest"]) == pytest.approx((0.216, 0.0625, 0.2))


def test_drawn_and_accepted_motions_stand_beside_each_other_for_the_level_and_for_the_cell(
    tmp_path,
):
    fast = {"average_speed": 0.09, "end_speed": 0.09, "maximum_speed": 0.09, "displacement": 0.3}
    slow = {"average_speed": 0.01, "end_speed": 0.01, "maximum_speed": 0.01, "displacement": 0.04}
    rows = [attempt(outcome="failed", **fast), attempt(attempt=1, **slow)]
    text = report(
        tmp_path, [make_episode(episode_path(tmp_path, level=1), level=1)], rows
    ).read_text()
    drawn = (
        "<td>drawn</td><td>1</td><td>0.0900</td><td>0.0900</td><td>0.300</td><td>0 %</td><td>0"
        " %</td><td>100 %</td>"
    )
    accepted = (
        "<td>accepted</td><td>1</td><td>0.0100</td><td>0.0100</td><td>0.040</td><td>100"
        " %</td><td>100 %</td><td>0 %</td>"
    )
    assert text.count(drawn) == text.count(accepted) == 2


def test_the_page_draws_the_histogram(dataset):
    svg = dataset[2][dataset[2].index("<svg") : dataset[2].index("</svg>")]
    # two episodes of level 1, both at SPEED all the time: one filled and one outlined rectangle of
    # full height
    heights = re.findall(
        r'<rect x="[\d.]+" width="[\d.]+" y="([\d.]+)" height="([\d.]+)" (?:fill="none"|fill="var)',
        svg,
    )
    assert heights == [("28.0", "112.0")] * 2
    line = re.search(r'<line x1="([\d.]+)" x2="([\d.]+)" y1="14"', svg)
    assert line and float(line[1]) == float(line[2]) == pytest.approx(
        8 + 344 * 0.1 / (1.08 * max(0.1, SPEED)), abs=0.06
    )
    assert ">alpha 0.1<" in svg and f">{1.08 * max(0.1, SPEED):.2f} m/s<" in svg


HOSTILE = "<script>alert('x')&\"quoted\""
ESCAPED = "&lt;script&gt;alert(&#39;x&#39;)&amp;&#34;quoted&#34;"


def test_hostile_names_are_escaped_wherever_they_stand(tmp_path):
    name = HOSTILE.replace("/", "")
    row = attempt(stage=HOSTILE, outcome="failed", reason=HOSTILE, average_speed=0.1)
    row |= {"task": name, "embodiment": name, "domain": name, "end_speed": 0.1, "displacement": 0.2}
    picture = Path("report/failed") / Cell(name, name, 1, 0.1, name).path / f"{name}-b-0-1.jpg"
    write_atomic(tmp_path / name / picture, b"jpeg")
    broken = tmp_path / name / "episode.hdf5"
    group = Group(
        Cell(name, name, 1, 0.1, name),
        [EpisodeFacts(broken, 1.0, 0.1, 0.1)],
        pa.Table.from_pylist([row], ATTEMPTS),
    )
    sheets = [Figure(b"", f'" onload={HOSTILE}')]
    text = write_report(tmp_path / name, [group], sheets).read_text()
    tags = parse(text)
    assert {tag for tag, _ in tags.seen} <= {
        "html",
        "head",
        "meta",
        "title",
        "style",
        "body",
        "nav",
        "a",
        "article",
        "header",
    } | {
        *("h1", "h2", "h3", "p", "div", "span", "b", "i", "figure", "img", "figcaption"),
        *("table", "thead", "tbody", "tr", "th", "td", "svg", "rect", "line", "text"),
    }
    assert all("onload" not in attrs for _, attrs in tags.seen)
    assert text.count(ESCAPED) >= 14 and "<script" not in text


def test_a_directory_whose_name_is_no_utf8_has_a_report(tmp_path):
    root = tmp_path / b"bytes\xff".decode(errors="surrogateescape")
    assert "<h1>bytes?</h1>" in report(root, [], []).read_text(encoding="utf-8")


def test_a_value_that_the_template_wants_and_is_not_given_is_named():
    with pytest.raises(UndefinedError, match="is undefined"):
        render_page("pipeline.report", "report.html")


@pytest.mark.parametrize(
    ("count", "columns", "meeting", "picks"),
    [
        (11, 6, None, [0, 2, 4, 6, 8, 10]),
        (101, 6, 10, [0, 5, 10, 40, 70, 100]),
        (101, 5, 20, [0, 10, 20, 60, 100]),
        (11, 6, 10, [0, 2, 4, 6, 8, 10]),
        (3, 6, 1, [0, 1, 2]),
        (9, 2, 4, [0, 8]),
    ],
)
def test_picked_frames(count, columns, meeting, picks):
    assert pick_frames(count, columns, meeting) == picks


def test_the_path_runs_through_the_middle_of_the_square_that_the_camera_saw(tmp_path):
    with open_episode(make_episode(tmp_path / "e.hdf5", frames=20)) as e:
        kind = e.meta.drawing.cameras["head_camera"].camera("head_camera").type
        poses = e.array("observation/head_camera/pose"), e.array("target/pose")
        pixels, in_front = path_pixels(kind, *poses)
        assert in_front.all()
        for i in (0, 9, 19):
            red = np.argwhere(
                np.abs(e.rgb("head_camera", i).astype(int) - COLORS["head_camera"]).sum(-1) < 60
            )
            assert np.allclose(red.mean(0)[::-1] + 0.5, pixels[i], atol=1.0)


def test_the_meeting_is_ringed_and_what_is_behind_the_camera_is_not_drawn():
    pixels = np.array([[20.0, 30], [60, 30], [100, 30]])
    image = np.zeros((60, 320, 3), np.uint8)
    draw_path(image, pixels, np.array([True, True, True]), now=0, meeting=2)
    assert (
        (image[30, 93] == MEETING_COLOR).all()
        and image[30, 80].max() > 100
        and image[45].max() == 0
    )
    hidden = np.zeros_like(image)
    draw_path(hidden, pixels, np.array([False, False, False]), now=0, meeting=2)
    assert hidden.max() == 0


def test_a_film_shows_the_frames_at_their_times(tmp_path):
    shots = film(make_episode(tmp_path / "e.hdf5", frames=31), columns=4, width=160).shots
    assert [s.time for s in shots] == pytest.approx([0, 15 / 15, 22 / 15, 30 / 15])
    assert [s.meeting for s in shots] == [False, True, False, False]
    assert all(s.rgb.shape == (120, 160, 3) for s in shots)


def test_the_contact_sheet_has_one_row_an_episode_with_its_pictures(tmp_path):
    paths = [make_episode(tmp_path / f"{i}.hdf5", frames=12, seed=i) for i in range(3)]
    sheet = contact_sheet(paths, columns=4, width=320)
    row = TITLE + 240 + GAP
    assert sheet.shape == (3 * row, 4 * (320 + GAP), 3)
    with open_episode(paths[1]) as e:
        target, camera = e.array("target/pose"), e.array("observation/head_camera/pose")[0]
    column, line = square_corner(
        Camera("head_camera", CAMERA_TYPES["D435"], None, camera), 0, target
    )
    shown = sheet[row + TITLE + line + 4, column + HALF // 4].astype(int)
    assert np.abs(shown - COLORS["head_camera"]).max() < 20
    assert (sheet[row - 1].reshape(4, -1, 3)[:, 0] == MEETING_COLOR).all(1).sum() == 1
