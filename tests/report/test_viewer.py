"""The viewer: its data against the episode, and the page itself in a browser without a network, by
clicks and keys."""

import base64
import io
import json
import socket
import threading
import time
import urllib.error
import urllib.request
from collections import Counter
from contextlib import contextmanager
from itertools import combinations, product

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.annotate.networks.masks import pack
from pipeline.annotate.store import write_entry, write_stage
from pipeline.data.cameras import project
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.state_log import SkillRun
from pipeline.data.slots.annotations import annotation_path
from pipeline.data.slots.records import ATTEMPTS
from pipeline.export.shared.video import frames_of
from pipeline.report.film_strip import meeting_frame
from pipeline.report.viewer import choose, viewer_server, write_viewer
from pipeline.report.viewer.data import episode_data, skill_rows, thumbnail
from pipeline.report.viewer.page import CONNECTIONS, fixed
from tests.browser import browse, needs_browser
from tests.synthetic import CAMERAS, episode_path, make_episode

FRAMES = 8
SLOW = 3  # other processes run beside the tests
LEFT_CAMERA = "document.querySelector('[data-camera=left_camera]').getContext('2d')"
FAILED = {"attempt": 2, "stage": "replay", "reason": "missed", "conditions": ["held"]}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A dataset of two episodes, the first with a mask of the target and flow in the head
    camera."""
    root = tmp_path_factory.mktemp("viewed")
    paths = [
        make_episode(
            episode_path(root, slot=i, level=i + 1), slot=i, seed=i, level=i + 1, frames=FRAMES
        )
        for i in range(2)
    ]
    mask = np.zeros((FRAMES, 1, 240, 320), bool)
    mask[:, :, 100:121, 50:91] = True
    write_stage(
        root,
        "masks@00000001",
        {"stage": "masks", "version": 1, "parameters": {"camera": "head_camera"}},
    )
    place = annotation_path(root, "masks@00000001", paths[0].relative_to(root / "episodes"))
    write_entry(
        place, "key", {"mask": pack(mask)}, {"objects": ["target"], "height": 240, "width": 320}
    )
    write_stage(
        root,
        "flow@00000001",
        {"stage": "flow", "version": 1, "parameters": {"camera": "head_camera"}},
    )
    place = annotation_path(root, "flow@00000001", paths[0].relative_to(root / "episodes"))
    write_entry(place, "key", {"rgb": np.full((FRAMES, 240, 320, 3), (40, 80, 160), np.uint8)}, {})
    return root, paths


def test_what_is_shown_is_the_episode(dataset):
    root, (path, other) = dataset
    shown = episode_data(path, root)
    with open_episode(path) as e:
        np.testing.assert_allclose(
            np.array(shown["state"]).T, e.array("joint_state/vector"), atol=1e-4
        )
        np.testing.assert_allclose(
            np.array(shown["action"]).T, e.array("joint_action/vector"), atol=1e-4
        )
        np.testing.assert_allclose(
            np.array(shown["path"]["target"]).T, e.array("target/pose")[:, :3], atol=1e-4
        )
        kind = e.meta.drawing.cameras["head_camera"].camera("head_camera").type
        uv, _ = project(
            kind, e.array("observation/head_camera/pose")[2], e.array("target/pose")[2, :3]
        )
        np.testing.assert_allclose(shown["cameras"]["head_camera"]["track"][2], uv, atol=0.06)
        np.testing.assert_allclose(
            shown["distance"]["left"],
            np.linalg.norm(e.read().log.tcp[:, 0, :3] - e.array("target/pose")[:, :3], axis=1),
            atol=1e-4,
        )
    assert [event["name"] for event in shown["events"]] == ["meeting", "release", "success"]
    assert shown["meeting"] == round(shown["events"][0]["time"] * 15)
    assert shown["again"] == f"domino-data verify {root} --episode {shown['file']}"
    assert shown["spans"] == [{"name": "left touches", "start": 4 / 15, "end": 5 / 15}]
    middle = FRAMES // 2 / 15
    assert [
        (run["arm"], run["said"], run["half"], run["start"], run["end"]) for run in shown["skills"]
    ] == [
        ("left", "grasp high target", "meet", 0, middle),
        ("right", "home", "meet", 0, middle),
        ("left", "lift target", "finish", middle + 0.5 / 15, (FRAMES - 1) / 15),
    ]
    film = base64.b64decode(shown["film"].split(",")[1])
    sheets = [rgb for _, rgb in frames_of(io.BytesIO(film))]
    assert len(sheets) == FRAMES and list(shown["boxes"]) == [*CAMERAS, "head_camera flow"]
    with open_episode(path) as e:
        for frame, camera in product((0, FRAMES - 1), CAMERAS):
            x, y, width, height = shown["boxes"][camera]
            seen = sheets[frame][y : y + height, x : x + width].astype(float)
            # 30 dB: another frame, or another camera, is farther away
            assert np.square(seen - e.rgb(camera, frame)).mean() < 65, (camera, frame)
    x, y, width, height = shown["boxes"]["head_camera flow"]
    assert (width, height) == (100, 75)
    assert np.abs(sheets[2][y : y + height, x : x + width].mean((0, 1)) - (40, 80, 160)).max() < 4
    corners = np.array(shown["cameras"]["head_camera"]["outlines"][0][0])
    assert corners.min(0).tolist() == [50, 100] and corners.max(0).tolist() == [90, 120]
    assert episode_data(other, root)["cameras"]["head_camera"]["outlines"] == []


def test_a_choice_is_spread_and_its_levels_are_balanced(tmp_path):
    many = [episode_path(tmp_path, slot=i) for i in range(20)]
    few = [episode_path(tmp_path, slot=i, level=2) for i in range(2)]
    assert (
        choose(many, 4) == [many[0], many[5], many[10], many[15]]
        and choose([*reversed(few)], 3) == few
    )
    assert [path.parent.parent.name for path in choose(many + few, 4)] == ["L1", "L1", "L2", "L2"]
    assert len(choose(many + few, 10)) == 10 and set(few) < set(choose(many + few, 10))
    assert choose([], 3) == []
    tasks = [f"task_{i}" for i in range(6)]
    cells = [(task, level, slot) for task in tasks for level in (1, 3) for slot in range(5)]
    paths = [
        tmp_path / task / "aloha" / f"L{level}" / "clean" / f"{slot}.hdf5"
        for task, level, slot in cells
    ]
    chosen = choose(paths, 12)
    shown = Counter((path.parts[-5], path.parts[-3]) for path in chosen)
    assert shown == dict.fromkeys(product(tasks, ("L1", "L3")), 1)


def test_a_failed_attempt_is_shown_with_its_reason_and_no_command(dataset):
    root, _ = dataset
    failed = make_episode(
        root / "failures/click_bell/failed.hdf5", frames=FRAMES, meta={"failure": FAILED}
    )
    shown = episode_data(failed, root)
    assert (shown["failure"], shown["again"]) == ("replay: missed (held)", "")


def test_the_list_is_made_of_the_table_of_attempts_and_opens_no_episode(tmp_path):
    cell = {"task": "click_bell", "embodiment": "aloha-agilex", "level": 2, "domain": "clean"}
    row = (
        dict.fromkeys(ATTEMPTS.names)
        | cell
        | {"alpha": 0.2, "slot": 3, "seed": 1 << 60, "stage": "replay"}
    )
    row |= {"seed": 1 << 60}
    lost = row | FAILED | {"outcome": "failed", "average_speed": float("nan")}
    won = row | {"attempt": 3, "outcome": "accepted", "average_speed": 0.15}
    pq.write_table(pa.Table.from_pylist([lost, won], ATTEMPTS), tmp_path / "attempts.parquet")
    place = "click_bell/aloha-agilex/L2@0.2/clean/episode_0000003"
    names = [f"episodes/{place}_v1.hdf5", f"failures/{place}_attempt_002.hdf5", "episodes/x.hdf5"]
    values = listed(fixed("list.js", tmp_path, [tmp_path / name for name in names], 9))
    why = "replay: missed (held)"
    assert values["episodes"] == [[names[0], 0.15, ""], [names[1], None, why], [names[2], None, ""]]
    (failure,) = values["failures"]
    assert (failure["file"], failure["seed"], values["total"]) == (names[1], str(1 << 60), 9)


def listed(script: bytes):
    """The values of list.js."""
    return json.loads(script.decode().removeprefix("listLoaded(").removesuffix(");\n"))


@contextmanager
def served(root, paths):
    """The address of a server of these episodes."""
    with viewer_server(root, paths, 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server.server_address[:2]
        finally:
            server.shutdown()
            thread.join()


def test_the_server_answers_on_this_machine_and_for_its_own_files_only(dataset):
    root, paths = dataset
    with served(root, paths) as (host, port):
        assert host == "127.0.0.1"

        def read(name):
            return urllib.request.urlopen(f"http://{host}:{port}/{name}").read()

        assert b"<title>" in read("") and listed(read("list.js"))["total"] == 2
        assert read("episode_1.js").startswith(b"episodeLoaded(1, {")
        assert read("thumb_1.jpg") == thumbnail(paths[1])
        answer = urllib.request.urlopen(f"http://{host}:{port}/list.js")
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        for name in ("episode_2.js", "thumb_2.jpg", "../manifest.yaml", "episodes/", "view.html"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                read(name)
        for headers in ({"Host": "evil.example"}, {"Origin": "https://evil.example"}):
            request = urllib.request.Request(f"http://{host}:{port}/list.js", headers=headers)
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(request)
        before = threading.active_count()
        half_open = [socket.create_connection((host, port)) for _ in range(3 * CONNECTIONS)]
        try:
            time.sleep(0.3)
            assert threading.active_count() - before <= CONNECTIONS
        finally:
            for each in half_open:
                each.close()


@needs_browser
def test_a_person_looks_through_the_pages(dataset, tmp_path):
    root, paths = dataset
    page_file = write_viewer(root, paths, tmp_path / "view", 7)
    with browse(page_file.as_uri(), tmp_path / "profile") as page:
        page.wait("document.querySelectorAll('#wall figure').length == 2")
        assert page.run("at('count').textContent") == "2 of 2 episodes, chosen from 7"
        assert page.run("at('wall').querySelector('h2').textContent") == "click bell accepted, 2"
        page.wait("[...document.querySelectorAll('#wall img')].every(i => i.naturalWidth == 224)")
        page.run("at('level').value = 'L2'; at('level').onchange()")
        assert page.run("document.querySelectorAll('#wall figure').length") == 1
        page.run("at('level').value = 'all'; at('level').onchange()")
        page.run("at('filter').value = 'bell L1 speed<9'; at('filter').oninput()")
        # the table of attempts, which has the speeds, is not there
        assert page.run("document.querySelectorAll('#wall figure').length") == 0
        page.run("at('filter').value = 'bell L1'; at('filter').oninput()")
        assert page.run("document.querySelectorAll('#wall figure').length") == 1
        page.run("at('filter').value = ''; at('filter').oninput()")
        assert page.run("document.querySelector('#wall figcaption').textContent") == "L1 · #0"
        page.click("#wall figure:nth-of-type(1)")
        page.wait("panes.length == 1 && document.querySelectorAll('.chart').length == 4")
        with open_episode(paths[0]) as e:
            assert page.run("frame") == meeting_frame(e.read()) > 0
        assert page.run("document.querySelector('.again code').textContent").endswith(
            f"{root} --episode {paths[0].relative_to(root)}"
        )
        page.press("Home")
        with open_episode(paths[0]) as e:
            log = e.read().log
        arms = [i for i, name in enumerate(log.vector_names) if not name.endswith("gripper")]
        assert (
            page.run("Number(document.querySelector('.charts select').value)")
            == arms[int(np.argmax(np.ptp(log.state[:, arms], axis=0)))]
        )
        rectangle = "(b => [b.x, b.y, b.right, b.bottom])(e.getBoundingClientRect())"
        boxes = page.run(f"[...document.querySelectorAll('.event span')].map(e => {rectangle})")
        assert len(boxes) == 3
        for (ax, ay, ar, ab), (bx, by, br, bb) in combinations(boxes, 2):
            assert ar <= bx or br <= ax or ab <= by or bb <= ay, "labels overprint"
        page.press("ArrowRight")
        page.press("ArrowRight")
        page.press("ArrowLeft")
        assert page.run("at('clock').textContent") == f"frame 1 of {FRAMES}, 0.07 s"
        wanted = ["left arm: grasp high target, 0.00 to 0.27 s", "right arm: home, 0.00 to 0.27 s"]
        assert (
            page.run(
                "[...document.querySelectorAll('.skill')].map(skill => skill.title).slice(0, 2)"
            )
            == wanted
        )
        page.wait("location.hash.endsWith('episode_0000000.hdf5&frame=1')")
        page.press("End")
        assert page.run("frame") == FRAMES - 1
        page.run("location.hash = location.hash.replace(/frame=.*/, 'frame=3')")
        page.wait("frame == 3")
        # the time line follows, and the curves tell the numbers at it and under the cursor
        line = "parseFloat(document.querySelector('.chart .now').style.left)"
        assert page.run(line) == pytest.approx(100 * 3.5 / FRAMES)
        told = "document.querySelectorAll('.charts output')[2].textContent"
        distance = episode_data(paths[0], root)["distance"]
        assert page.run(told) == f"0.20 s: {distance['left'][3]:.3f}, {distance['right'][3]:.3f} m"
        page.hover(".charts figure:nth-of-type(1) ~ figure .chart", 0.99)
        assert page.run(told).startswith(f"{(FRAMES - 1) / 15:.2f} s: ")
        page.press("n")
        page.wait("panes[0].data.file.includes('L2')")
        page.press("p")
        page.wait("panes[0].data.file.includes('L1')")
        page.press("Home")
        with open_episode(paths[0]) as e:
            # the middle of the wrist image, away from its square, is as in the episode
            x, y = 300, 220
            wanted = e.rgb("left_camera", 0)[y, x].astype(int)
        pixel = f"[...{LEFT_CAMERA}.getImageData({x}, {y}, 1, 1).data].slice(0, 3)"
        # images are drawn when they are decoded
        page.wait(f"{pixel}.some(value => value > 0)")
        got = page.run(pixel)
        assert np.abs(np.array(got) - wanted).max() < 12
        # the square of the wrist camera drifts by 3 pixels a frame: the frame that is asked for is
        # the one that is drawn
        page.run("go(6)")
        row = f"[...{LEFT_CAMERA}.getImageData(0, 80, 320, 1).data]"
        page.wait(f"({row})[4 * 130 + 1] > 160")
        with open_episode(paths[0]) as e:
            wanted, got = e.rgb("left_camera", 6)[80], np.array(page.run(row)).reshape(320, 4)
        edges = [np.flatnonzero(pixels[:, 1] > 160)[[0, -1]] for pixels in (wanted, got)]
        assert np.abs(edges[0] - edges[1]).max() <= 1
        seen = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        assert seen.shape[1] == 1300 and seen.std() > 10
        assert page.run("at('show-masks').parentElement.hidden") is False
        page.press("n")
        page.wait("panes[0].data.file.includes('L2') && at('show-masks').parentElement.hidden")
        page.press("c")
        page.wait("at('count').textContent == 'click the episode to compare with'")
        page.click("#wall figure:nth-of-type(1)")
        page.wait("panes.length == 2")
        page.press("ArrowRight")
        # both stand one frame after their meetings
        assert page.run("panes.map(pane => pane.frame - pane.data.meeting)") == [1, 1]
        page.wait("/episode=.*L2.*&with=.*L1.*&frame=/.test(location.hash)")
        page.press("c")
        page.wait("panes.length == 1")
        page.run("location.hash = '#episode=a+b.hdf5&frame=1'")
        page.wait("at('count').textContent.includes('a+b.hdf5 is not on this page')")
        page.run("location.hash = '#episode=episodes/none.hdf5&frame=1'")
        page.wait("at('count').textContent.includes('none.hdf5 is not on this page')")
        assert page.run("at('to-failures').hidden")
        page.press("Escape")
        assert page.run("!at('wall').hidden")
        assert page.errors == []


def test_skills_within_a_skill_are_said_with_it():
    runs = [
        SkillRun("hand_over", ("left", "right"), "mug", "", "finish", 0, 48),
        SkillRun("grasp", ("right",), "mug", "low_rim", "finish", 16, 32),
        SkillRun("open", ("left",), "mug", "", "finish", 48, 60),
    ]
    assert [(run["arm"], run["said"], run["end"]) for run in skill_rows(runs, 240)] == [
        ("left", "hand_over mug", 0.2),
        ("right", "hand_over mug, grasp", 0.2),
        ("left", "open mug", 0.25),
    ]


@needs_browser
def test_a_thousand_episodes_are_on_the_screen_at_once(tmp_path):
    """First paint, with the thumbnails on the screen, is under 3 s and 20 MB; and no policy of the
    page stops it."""
    first = make_episode(episode_path(tmp_path, slot=0), frames=FRAMES)
    paths = [episode_path(tmp_path, slot=i) for i in range(1000)]
    for path in paths[1:]:
        path.hardlink_to(first)
    with (
        served(tmp_path, paths) as (host, port),
        browse(f"http://{host}:{port}/", tmp_path / "profile", offline=False) as page,
    ):
        page.wait("typeof listed == 'object' && listed.length == 1000")
        page.wait("document.querySelectorAll('#wall img')[5].naturalWidth > 0")
        seconds, size = page.run(
            "(all => [Math.max(...all.map(e => e.responseEnd)) / 1000,"
            " all.reduce((sum, e) => sum + e.transferSize, 0)])(performance.getEntries()"
            ".filter(e => e.transferSize))"
        )
        assert seconds < 3 * SLOW and 10_000 < size < 2e6
        page.run("window.scrollTo(0, 1e9)")
        page.wait("document.querySelectorAll('#wall figure').length > 300")
        assert page.errors == []
