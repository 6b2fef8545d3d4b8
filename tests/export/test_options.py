"""Options of formats: parsed from texts, one line for each that is wrong."""

from dataclasses import dataclass, fields

import pytest
from typer import TyperException

from pipeline import cli
from pipeline.commands.export import GIVEN
from pipeline.data.names import exported_names
from pipeline.export import EXPORTERS, ExportError, option, parse_options
from pipeline.export.options import camera_names, image_size, is_flag, one_of, whole


@dataclass(frozen=True)
class Options:
    color: str = option("red or blue", one_of("red", "blue"))
    count: int = option("how many", whole(2, 9), 5)
    all: bool = option("everything", default=False)


def test_texts_become_values_and_defaults_stay():
    assert parse_options("f", Options, {"color": "red"}) == Options("red", 5, False)
    assert parse_options("f", Options, {"color": "blue", "count": "2", "all": True}) == Options(
        "blue", 2, True
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "--format f needs --color: red or blue"),
        ({"color": "green"}, "--color 'green': choose red or blue"),
        ({"color": "red", "count": "1"}, "--count '1' is not a whole number from 2 to 9"),
        ({"color": "red", "count": "2.5"}, "--count '2.5' is not a whole number from 2 to 9"),
        (
            {"color": "red", "jpeg_order": "rgb"},
            "--jpeg-order is not an option of --format f; its options are: --color, --count, --all",
        ),
    ],
)
def test_what_is_wrong_is_one_line(given, said):
    with pytest.raises(ExportError) as error:
        parse_options("f", Options, given)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rotation": "6d"}, "--rotation 6d is of tool poses"),
        ({"actions": "joints-delta", "frame": "base"}, "--frame base is of tool poses"),
        ({"actions": "ee-relative", "frame": "base"}, "--frame base is of tool poses"),
        ({"more_actions": "ee-delta,joints"}, "--more-actions joints: the feature action"),
        ({"more_actions": "ee-delta", "rotation": "6d"}, ""),
        ({"more_actions": "ee", "rotation": "6d", "frame": "base"}, ""),
        ({"actions": "ee", "frame": "base"}, ""),
    ],
)
def test_options_of_actions_that_change_nothing_are_refused(given, said):
    kind = EXPORTERS["lerobot"].options
    if not said:
        assert parse_options("lerobot", kind, given)
        return
    with pytest.raises(ExportError, match=said):
        parse_options("lerobot", kind, given)


def test_an_option_takes_a_value_in_all_formats_or_in_none():
    kinds = {(f.name, is_flag(f)) for each in EXPORTERS.values() for f in fields(each.options)}
    assert len({name for name, _ in kinds}) == len(kinds)


def test_sizes_and_camera_names():
    assert image_size("640x480") == (480, 640)
    for text in ("640", "0x480", "640x480x3", "axb"):
        with pytest.raises(ValueError, match="WIDTHxHEIGHT"):
            image_size(text)
    assert camera_names("head=top,right_camera=hand") == {
        "head_camera": "top",
        "right_camera": "hand",
    }
    for text in ("head", "head=", "=top", "head=a=b"):
        with pytest.raises(ValueError, match="camera=name"):
            camera_names(text)


def test_cameras_get_the_names_of_the_field_unless_others_are_given():
    cameras = ("head_camera", "left_camera", "right_camera")
    assert list(exported_names(cameras, {}).values()) == [
        "cam_high",
        "cam_left_wrist",
        "cam_right_wrist",
    ]
    assert exported_names((*cameras, "front_camera"), {"left_camera": "wrist"}) == {
        "head_camera": "cam_high",
        "left_camera": "wrist",
        "right_camera": "cam_right_wrist",
        "front_camera": "front_camera",
    }
    for given, said in (
        ({"front_camera": "x"}, "no camera front_camera"),
        ({"head_camera": "../x"}, "is no camera name"),
        ({"head_camera": "cam_left_wrist"}, "the same name"),
    ):
        with pytest.raises(ValueError, match=said):
            exported_names(cameras, given)


def given(*args: str) -> dict[str, object]:
    """What a command line gives to the format."""
    with cli.Verbs().load("export").make_context("export", list(args)) as context:
        return context.meta[GIVEN]


def test_the_options_of_a_format_are_options_of_the_command():
    args = ("--jpeg-order", "rgb", "OUT", "--format", "aloha", "--pad-rows", "--out=x")
    assert given(*args) == {"jpeg_order": "rgb", "pad_rows": True}
    assert given("OUT", "--format=aloha", "--jpeg-order=rgb") == {"jpeg_order": "rgb"}
    for wrong, said in (("--jpeg-order", "requires an argument"), ("--paddle", "No such option")):
        with pytest.raises(TyperException) as raised:
            given("OUT", "--format", "aloha", wrong)
        assert said in raised.value.format_message()
