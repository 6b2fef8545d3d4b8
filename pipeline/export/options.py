"""Options of an export format: the fields of a frozen dataclass, each made by `option`."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from functools import partial
from typing import Any

from pipeline.data import parsing
from pipeline.data.actions import ACTIONS, FRAMES, JOINTS, ROTATIONS, Representation
from pipeline.data.names import CAMERAS
from pipeline.data.parsing import LARGEST_NUMBER, ParseError, pixels, show_value
from pipeline.export.shared.episodes import ExportError
from pipeline.export.shared.labels import LABELS


@dataclass(frozen=True)
class NoOptions:
    """Options of a format that has none."""


def option(
    help: str,
    parse: Callable[[str], Any] = str,
    default: Any = MISSING,
    factory: Any = MISSING,
    quiet: bool = False,
) -> Any:
    """A field of an options dataclass. `parse` makes the value of a text or raises ValueError.
    export.json leaves out a `quiet` one at its default. A bool is a flag; one without a default
    must be given."""
    metadata = {"help": help, "parse": parse, "quiet": quiet}
    if factory is not MISSING:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


def flag_name(f: Field[Any]) -> str:
    """The option as it is typed: "jpeg_order" -> "--jpeg-order"."""
    return "--" + f.name.replace("_", "-")


def is_flag(f: Field[Any]) -> bool:
    """Whether the option takes no value."""
    return isinstance(f.default, bool)


def parse_options[O](format: str, kind: type[O], given: Mapping[str, str | bool]) -> O:
    """The options of a format from texts by field name. Raises ExportError for an unknown, a
    missing and a wrong one."""
    known: dict[str, Field[Any]] = {f.name: f for f in fields(kind)}  # pyright: ignore[reportArgumentType]
    for name in given:
        if name not in known:
            has = ", ".join(flag_name(f) for f in known.values()) or "none"
            raise ExportError(
                f"--{name.replace('_', '-')} is not an option of --format {format}; its options"
                f" are: {has}"
            )
    values: dict[str, Any] = {}
    for name, f in known.items():
        if name not in given:
            if f.default is MISSING and f.default_factory is MISSING:
                raise ExportError(f"--format {format} needs {flag_name(f)}: {f.metadata['help']}")
            continue
        text = given[name]
        try:
            values[name] = (
                text if isinstance(text, bool) else f.metadata["parse"](parsing.line(text))
            )
        except ParseError as error:
            raise ExportError(f"{flag_name(f)} {show_value(text)} {error}") from error
        except ValueError as error:
            raise ExportError(f"{flag_name(f)} {show_value(text)}: {error}") from error
    return kind(**values)


def one_of(*names: str) -> Callable[[str], str]:
    """A parser that takes one of these names."""

    def parse(text: str) -> str:
        if text not in names:
            raise ValueError(f"choose {' or '.join(names)}")
        return text

    return parse


def several_of(*names: str) -> Callable[[str], tuple[str, ...]]:
    one = one_of(*names)

    def parse(text: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(map(one, text.split(","))))

    return parse


def whole(minimum: int, maximum: int = LARGEST_NUMBER) -> Callable[[str], int]:
    """A parser of whole numbers from `minimum` to `maximum`."""
    return partial(parsing.whole, low=minimum, high=maximum)


def image_size(text: str) -> tuple[int, int]:
    """ "640x480" (width x height) -> (480, 640)."""
    width, height = pixels(text)
    return height, width


def camera_names(text: str) -> dict[str, str]:
    """ "head=top,left=wrist" -> {"head_camera": "top", "left_camera": "wrist"}."""
    pairs = [part.split("=") for part in text.split(",")]
    if any(len(pair) != 2 or not pair[0] or not pair[1] for pair in pairs):
        raise ValueError("write camera=name, separated by commas, like head=top,left=wrist_1")
    return {CAMERAS.get(camera, camera): name for camera, name in pairs}


CAMERA_NAMES_HELP = (
    "exported names of cameras, like head=top,left=wrist_1; default cam_high, cam_left_wrist,"
    " cam_right_wrist"
)


def camera_names_option() -> Any:
    """The option `camera_names`: exported names by the dataset's."""
    return option(CAMERA_NAMES_HELP, camera_names, factory=dict)


@dataclass(frozen=True)
class ActionOptions:
    """What an action is (data/actions.py)."""

    actions: str = option(
        f"what an action is: {', '.join(ACTIONS)}",
        one_of(*ACTIONS),
        JOINTS.actions,
        quiet=True,
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
            raise ExportError(
                f"--rotation {self.rotation} is of tool poses: it needs --actions ee, ee-relative"
                " or ee-delta"
            )
        if self.frame != JOINTS.frame and all(one.reference != "absolute" for one in poses):
            raise ExportError(
                f"--frame {self.frame} is of absolute tool poses: it needs --actions ee"
            )

    @property
    def representations(self) -> tuple[Representation, ...]:
        """All representations that an export holds."""
        return (self.representation,)

    @property
    def representation(self) -> Representation:
        """The representation that these options choose."""
        return Representation(self.actions, self.rotation, self.frame)


@dataclass(frozen=True)
class LabelOptions(ActionOptions):
    """Options of formats that can hold labels of objects (shared/labels.py)."""

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
    """Options as export.json has them."""
    usual = {f.name: f.default for f in fields(options) if f.metadata.get("quiet")}
    return {k: v for k, v in asdict(options).items() if k not in usual or v != usual[k]}
