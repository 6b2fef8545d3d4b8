"""A spec that is not sound is refused where its robot is used, in one line that names the robot,
the thing and the fix."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.world.robots import ALIASES, MODELS, RobotError, get_embodiment, register
from pipeline.world.robots.contract import Arm, check_arm

PIPER = MODELS["piper"].arm("left")


def without(arm: Arm, name: str) -> Arm:
    """The arm without the joint of a name."""
    return replace(arm, joints=tuple(j for j in arm.joints if j.name != name))


def joint(arm: Arm, name: str, **changes) -> Arm:
    """The arm with one joint changed."""
    return replace(
        arm, joints=tuple(replace(j, **changes) if j.name == name else j for j in arm.joints)
    )


BROKEN = {
    "missing joint": (without(PIPER, "joint8"), "links 'base_link', 'link8' hang on no joint"),
    "undriven joint": (
        replace(PIPER, arm_joints=PIPER.arm_joints[:5]),
        "joint 'joint6' moves but nothing drives it",
    ),
    "missing jaw": (
        replace(PIPER, gripper=replace(PIPER.gripper, joints=("joint7", "jaw"))),
        "gripper.joints names 'jaw'.*one of joint1",
    ),
    "jaw that does not move": (joint(PIPER, "joint7", kind="fixed"), "'joint7', which is fixed"),
    "missing hand": (
        replace(PIPER, hand="tool0"),
        "hand names 'tool0'.*missing from links: use one of base_link",
    ),
    "missing finger": (
        replace(PIPER, gripper=replace(PIPER.gripper, fingers=("link7", "link9"))),
        "gripper.fingers names 'link9'",
    ),
    "missing overlap": (
        replace(PIPER, allowed_overlap=(("link7", "pad"),)),
        "allowed_overlap names 'pad'",
    ),
    "ring": (
        joint(PIPER, "joint1", parent="link6", child="base_link"),
        "list joints from the base",
    ),
    "order": (replace(PIPER, joints=PIPER.joints[::-1]), "list joints from the base"),
    "limits": (joint(PIPER, "joint2", lower=4.0), "joint 'joint2' needs limits lower < upper"),
    "home": (
        replace(PIPER, home=(0.0, -1.0, *PIPER.home[2:])),
        "home puts joint 'joint2' at -1, outside 0 to 3.14",
    ),
    "home of another": (replace(PIPER, home=PIPER.home[:5]), "home has 5 values for 6 arm_joints"),
    "jaw stroke": (
        replace(PIPER, gripper=replace(PIPER.gripper, opened=(0.05, 0.05))),
        "gripper.opened puts joint 'joint7' at",
    ),
    "tcp": (replace(PIPER, tcp=np.array([0, 0, 0.1, 0, 0, 0, 0.0])), "tcp is no pose"),
    "mass": (
        replace(PIPER, links=(replace(PIPER.links[0], mass=0.0), *PIPER.links[1:])),
        "link 'base_link' needs a mass",
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_specs_that_exist_are_sound(name):
    for side in ("left", "right"):
        check_arm(name, side, MODELS[name].arm(side))


@pytest.mark.parametrize("what", BROKEN)
def test_what_is_wrong_is_named_with_its_fix(what):
    arm, said = BROKEN[what]
    with pytest.raises(RobotError, match=said) as error:
        check_arm("wobbly", "left", replace(arm, model="wobbly"))
    assert str(error.value).startswith("robot 'wobbly', left arm: ") and "\n" not in str(
        error.value
    )


@pytest.fixture
def wobbly(tmp_path_factory, monkeypatch):
    """A registered robot whose right arm lacks a joint."""
    arms = {"left": PIPER, "right": without(MODELS["piper"].arm("right"), "joint8")}
    package = shutil.copytree(
        MODELS["piper"].directory, tmp_path_factory.mktemp("robots") / "wobbly"
    )
    toml = (package / "robot.toml").read_text()
    (package / "robot.toml").write_text(toml.replace('["agilex-piper"]', '["wob"]'))
    monkeypatch.setattr(register(package), "arm", lambda side: replace(arms[side], model="wobbly"))
    yield "wobbly"
    MODELS.remove("wobbly")
    del ALIASES["wob"]


@pytest.mark.parametrize("name", ["wobbly", "piper+wob"])
@pytest.mark.parametrize("verb", [("build",), ("plan",), ("check-task", "click_bell")])
def test_the_command_says_it_in_one_line(capsys, monkeypatch, tmp_path, wobbly, verb, name):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["domino-data", *verb, "--embodiment", name])
    with pytest.raises(SystemExit) as leave:
        main()
    out, err = capsys.readouterr()
    assert (leave.value.code, out, list(tmp_path.iterdir())) == (2, "", [])
    assert (
        err.startswith("domino-data: robot 'wobbly', right arm: links 'base_link', 'link8' hang")
        and err.count("\n") == 1
    )


def test_a_sound_side_may_be_paired_with_another_robot(wobbly):
    assert [arm.model for arm in get_embodiment("wobbly+piper").arms.values()] == [
        "wobbly",
        "piper",
    ]


@pytest.mark.parametrize("names", [("piper",), ("new", "ur5"), ("New",), ("a+b",), ("new", "")])
def test_names_are_unique_and_plain(tmp_path, names):
    before = dict(MODELS), dict(ALIASES)
    package = shutil.copytree(MODELS["piper"].directory, tmp_path / names[0])
    toml = (package / "robot.toml").read_text()
    (package / "robot.toml").write_text(toml.replace('["agilex-piper"]', json.dumps(names[1:])))
    with pytest.raises(RobotError, match=r"another robot is called|is no name"):
        register(package)
    assert (dict(MODELS), dict(ALIASES)) == before
