"""Robots through the whole factory: a mixed pair, one arm, a sixth robot from a directory, and bad
input."""

import json
import shutil
from pathlib import Path

import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.run.identity.slot_keys import content_key
from pipeline.tasks import TASKS
from pipeline.tasks.layout import can_do
from pipeline.world import robots
from pipeline.world.robots import ALIASES, MODELS, get_embodiment
from tests.run.command import WANTED, inside

TINY = (*WANTED, "--levels", "1", "--executor", "inline", "--quiet")


@pytest.fixture
def say():
    """Run the command in this process; what it printed, or its one line of complaint where it must
    leave with code 2."""

    def run(*arguments, code=0):
        left, out, err = inside(*arguments)
        assert left == code, err
        assert code != 2 or (
            out == "" and err.startswith("domino-data: ") and err.count("\n") == 1
        ), err
        return err if code == 2 else out

    return run


def only_episode(root: Path) -> Path:
    (path,) = sorted(Dataset(root).episodes.rglob("*.hdf5"))
    return path


def test_a_mixed_pair_has_six_and_seven_joints(say, tmp_path):
    out = tmp_path / "out"
    assert (
        json.loads(
            say("build", *TINY, "--embodiment", "piper+franka-panda", "--out", out, "--json")
        )["accepted"]
        == 1
    )
    with open_episode(only_episode(out)) as e:
        assert e.spec.embodiment == "piper+franka-panda"
        widths = {
            key: e.array(f"joint_action/{key}").reshape(len(e), -1).shape[1]
            for key in ("left_arm", "right_arm", "vector")
        }
        assert widths == {"left_arm": 6, "right_arm": 7, "vector": 6 + 1 + 7 + 1}
        names = e.read().log.vector_names
        assert (
            names[6] == "left_gripper"
            and names[-1] == "right_gripper"
            and names[7] == "right_panda_joint1"
        )
        assert e.array("joint_state/vector").shape == (len(e), 15)
    assert json.loads(say("verify", out, "--json"))["ok"]


# --- one arm
# ------------------------------------------------------------------------------------------


def test_one_arm_has_its_own_vectors_camera_and_side(say, tmp_path):
    out = tmp_path / "out"
    assert (
        json.loads(say("build", *TINY, "--embodiment", "none+panda", "--out", out, "--json"))[
            "accepted"
        ]
        == 1
    )
    with open_episode(only_episode(out)) as e:
        assert (e.spec.embodiment, e.cameras) == (
            "none+franka-panda",
            ("head_camera", "right_camera"),
        )
        assert e.read().log.vector_names == (
            *(f"right_panda_joint{i}" for i in range(1, 8)),
            "right_gripper",
        )
        assert not e.has("endpose/left_endpose") and not e.has("joint_action/left_arm")
        assert e.array("endpose/right_endpose").shape == (len(e), 7) and e.read().log.tcp.shape == (
            len(e),
            1,
            7,
        )
        assert e.array("objects/bell/pose")[-1, 0] > 0 and e.meta.arms == {"arm": "right"}
        assert not any(name.startswith("left_") for name in e.names("state", "bodies"))
    assert "written" in say("export", out, "--format", "lerobot")
    info = json.loads((out / "exports" / "lerobot" / "meta" / "info.json").read_text())["features"]
    assert info["action"]["shape"] == info["observation.state"]["shape"] == [8] and info["ee.pose"][
        "shape"
    ] == [7]
    assert [name for name in info if "images" in name] == [
        "observation.images.cam_high",
        "observation.images.cam_right_wrist",
    ]
    assert json.loads(say("verify", out, "--json"))["ok"]


def test_tasks_that_need_the_other_arm_are_refused_by_name(say, tmp_path):
    out = tmp_path / "out"
    said = say(
        "build",
        "--tasks",
        "click_bell,handover_mic,put_bottles_dustbin",
        "--embodiment",
        "none+piper",
        "--out",
        out,
        code=2,
    )
    assert (
        "none+piper has no arm for handover_mic, put_bottles_dustbin" in said and not out.exists()
    )
    assert can_do(TASKS["put_bottles_dustbin"], ("left",)) and not can_do(
        TASKS["handover_mic"], ("left",)
    )
    assert "'none'" in say("plan", "--embodiment", "none", code=2)
    assert "'none+none'" in say("plan", "--embodiment", "none+none", code=2)


# --- a sixth robot
# ------------------------------------------------------------------------------------------


@pytest.fixture
def six(tmp_path, monkeypatch):
    """A directory for --plugins with a robot of its own, `six`: piper's files under another
    name."""
    package = Path(shutil.copytree(MODELS["piper"].directory, tmp_path / "mine" / "robots" / "six"))
    toml = (package / "robot.toml").read_text()
    (package / "robot.toml").write_text(toml.replace('["agilex-piper"]', '["sixth"]'))
    monkeypatch.setenv("DOMINO_PLUGINS", "")  # the command sets it for this process
    robots._build.cache_clear()
    yield tmp_path / "mine"
    if "six" in MODELS:
        for alias in MODELS.remove("six").settings.aliases:
            del ALIASES[alias]


def test_a_directory_is_a_robot_and_its_files_are_its_key(say, six, tmp_path):
    listed = {e["name"]: e for e in json.loads(say("embodiments", "--json", "--plugins", six))}
    assert list(listed)[-1] == "six" and listed["six"]["dof"] == 14
    out = tmp_path / "out"
    assert (
        json.loads(say("build", *TINY, "--embodiment", "sixth", "--out", out, "--json"))["accepted"]
        == 1
    )
    assert json.loads(say("verify", out, "--json"))["ok"]
    assert only_episode(out).relative_to(out).parts[2] == "six"
    assert get_embodiment("six+ur5").arms["left"].model == "six"
    before = content_key(six / "robots" / "six")
    with open(six / "robots" / "six" / "robot.urdf", "a") as f:
        f.write("<!-- another -->")
    after = content_key(six / "robots" / "six")
    assert (before["looks"] == after["looks"], before["physics"] == after["physics"]) == (
        True,
        False,
    )


def test_a_mistake_in_a_robot_is_one_line(say, six, tmp_path):
    path = six / "robots" / "six" / "robot.toml"
    text = path.read_text()
    path.write_text(text.replace('hand = "link6"', 'hand = "tool0"'))
    line = say(
        "build", *TINY, "--plugins", six, "--embodiment", "six", "--out", tmp_path / "out", code=2
    )
    assert (
        "robot 'six', left arm: hand names 'tool0', which is missing from links: use one of"
        " base_link" in line
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('hand = "link6"', "", "robot.toml: hand: Field required"),
        ("foot = ", "feet = ", "robot.toml: "),
        ("[tcp]", "[tcp", "robot.toml: not readable"),
        ("opening = 0.08", "opening = nan", "robot.toml: gripper.opening: "),
        ("[place.right]", "[place.top]", "robot.toml: place.top"),
    ],
)
def test_a_broken_robot_toml_is_one_line(say, six, old, new, said):
    path = six / "robots" / "six" / "robot.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert said in say("embodiments", "--plugins", six, code=2)


# --- bad input
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["r2d2", "piper+", "piper+r2d2"])
def test_an_unknown_robot_is_one_line_everywhere(say, tmp_path, robot):
    for verb in (("build", "--out", tmp_path / "out"), ("plan",), ("check-task", "click_bell")):
        assert repr(robot) in say(*verb, "--embodiment", robot, code=2)
    assert list(tmp_path.iterdir()) == []
