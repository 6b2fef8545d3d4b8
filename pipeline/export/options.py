"""Options of an export format: fields of a frozen dataclass."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from functools import partial
from typing import Any

from pipeline.data import parsing
from pipeline.data.actions import ACTIONS, FRAMES, JOINTS, ROTATIONS, Representation
from pipeline.data.names import CAMERAS

from .shared.derived import LABELS
from .shared.episodes import ExportError


@dataclass(frozen=True)
class NoOptions: ...


def option(
    help: str,
    parse: Callable[[str], Any] = str,
    default: Any = MISSING,
    factory: Any = MISSING,
    quiet: bool = False,
) -> Any:
    """A field of options. `parse` raises ValueError; export.json leaves out a `quiet` default."""
    metadata = {"help": help, "parse": parse, "quiet": quiet}
    if factory is not MISSING:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


def flag_name(f: Field[Any]) -> str:
    """The option as it is typed: "jpeg_order" -> "--jpeg-order"."""
    return "--" + f.name.replace("_", "-")


def is_flag(f: Field[Any]) -> bool:
    return isinstance(f.default, bool)


def parse_options[O](format: str, kind: type[O], given: Mapping[str, str | bool]) -> O:
    known: dict[str, Field[Any]] = {f.name: f for f in fields(kind)}  # pyright: ignore[reportArgumentType]
    values: dict[str, Any] = {}
    if unknown := [name for name in given if name not in known]:
        flag, has = unknown[0].replace("_", "-"), ", ".join(map(flag_name, known.values()))
        raise ExportError(
            f"--{flag} is not an option of --format {format}; its options are: {has or 'none'}"
        )
    for name, f in known.items():
        if name not in given:
            if f.default is MISSING and f.default_factory is MISSING:
                raise ExportError(f"--format {format} needs {flag_name(f)}: {f.metadata['help']}")
            continue
        text = given[name]
        try:
            is_text = not isinstance(text, bool)
            values[name] = f.metadata["parse"](parsing.line(text)) if is_text else text
        except ValueError as error:
            sign = " " if isinstance(error, parsing.ParseError) else ": "
            raise ExportError(f"{flag_name(f)} {parsing.show_value(text)}{sign}{error}") from error
    return kind(**values)


def one_of(*names: str) -> Callable[[str], str]:
    def parse(text: str) -> str:
        if text not in names:
            raise ValueError(f"choose {' or '.join(names)}")
        return text

    return parse


def several_of(*names: str) -> Callable[[str], tuple[str, ...]]:
    one = one_of(*names)
    return lambda text: tuple(dict.fromkeys(map(one, text.split(","))))


def whole(minimum: int, maximum: int = parsing.LARGEST_NUMBER) -> Callable[[str], int]:
    return partial(parsing.whole, low=minimum, high=maximum)


def image_size(text: str) -> tuple[int, int]:
    """ "640x480" (width x height) -> (480, 640)."""
    width, height = parsing.pixels(text)
    return height, width


def camera_names(text: str) -> dict[str, str]:
    """ "head=top,left=wrist" -> {"head_camera": "top", "left_camera": "wrist"}."""
    pairs = [part.split("=") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise ValueError("write camera=name, separated by commas, like head=top,left=wrist_1")
    return {CAMERAS.get(camera, camera): name for camera, name in pairs}


CAMERA_NAMES_HELP = (
    "exported names of cameras, like head=top,left=wrist_1; default cam_high, cam_left_wrist,"
    " cam_right_wrist"
)


def camera_names_option(help: str = CAMERA_NAMES_HELP) -> Any:
    return option(help, camera_names, factory=dict)


def jpeg_order_option(help: str, default: Any = MISSING) -> Any:
    return option(help, one_of("rgb", "bgr"), default)


@dataclass(frozen=True)
class ActionOptions:
    """What an action is (data/actions.py)."""

    actions: str = option(
        f"what an action is: {', '.join(ACTIONS)}", one_of(*ACTIONS), JOINTS.actions, quiet=True
    )
    rotation: str = option(
        f"rotations of tool poses: {', '.join(ROTATIONS)}",
        one_of(*ROTATIONS),
        JOINTS.rotation,
        quiet=True,
    )
    frame: str = option(
        f"frame of absolute tool poses: {', '.join(FRAMES)}",
        one_of(*FRAMES),
        JOINTS.frame,
        quiet=True,
    )

    def __post_init__(self) -> None:
        poses = [one for one in self.representations if one.poses]
        if self.rotation != JOINTS.rotation and not poses:
            needs = "is of tool poses: it needs --actions ee, ee-relative or ee-delta"
            raise ExportError(f"--rotation {self.rotation} {needs}")
        if self.frame != JOINTS.frame and all(one.reference != "absolute" for one in poses):
            raise ExportError(f"--frame {self.frame} is of tool poses: it needs --actions ee")

    @property
    def representations(self) -> tuple[Representation, ...]:
        return (self.representation,)

    @property
    def representation(self) -> Representation:
        return Representation(self.actions, self.rotation, self.frame)


@dataclass(frozen=True)
class ImageOptions(ActionOptions):
    """Options of formats that hold images of any size, (height, width) in pixels."""

    size: tuple[int, int] | None = option(
        "WIDTHxHEIGHT in pixels to resize images to, like 640x480", image_size, None
    )
    camera_names: Mapping[str, str] = camera_names_option()


@dataclass(frozen=True)
class LabelOptions(ActionOptions):
    labels: tuple[str, ...] = option(
        f"labels of all objects, as further columns: {', '.join(LABELS)}",
        several_of(*LABELS),
        (),
        quiet=True,
    )


def representation_of(options: Any) -> Representation:
    """Joints, in formats that cannot choose."""
    return options.representation if isinstance(options, ActionOptions) else JOINTS


def recorded(options: Any) -> dict[str, Any]:
    usual = {f.name: f.default for f in fields(options) if f.metadata.get("quiet")}
    return {k: v for k, v in asdict(options).items() if k not in usual or v != usual[k]}
