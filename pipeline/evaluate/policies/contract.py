"""What a policy was made for."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, replace
from typing import Any

from pydantic.dataclasses import dataclass

from pipeline.data.actions import JOINTS, Representation
from pipeline.data.episode.meta import camera_name
from pipeline.data.setup import INTERFACE, RecipeError, Setup, option_of
from pipeline.evaluate.lines import line_of_text

from .policy import LONGEST_CHUNK, Policy, PolicyError, Start, attribute


@dataclass(frozen=True)
class Contract:
    """What a policy was made for; None means anything. `image_sizes` are (height, width) by
    needed camera, `rate` actions a second, `chunk` the most actions in one answer; the others
    are those of data/actions.py."""

    action_names: tuple[str, ...] | None = None
    image_sizes: Mapping[str, tuple[int, int]] | None = None
    rate: int | None = None
    chunk: int | None = None
    representation: str = JOINTS.actions
    rotation: str = JOINTS.rotation
    frame: str = JOINTS.frame

    @classmethod
    def of(cls, actions: Representation) -> "Contract":
        return cls(representation=actions.actions, rotation=actions.rotation, frame=actions.frame)

    @property
    def actions(self) -> Representation:
        try:
            return Representation(self.representation, self.rotation, self.frame)
        except ValueError as error:
            raise PolicyError(f"the policy's {line_of_text(str(error))}") from error

    def to_dict(self) -> dict[str, Any]:
        unused = () if self.representation != JOINTS.actions else ("rotation", "frame")
        return {k: v for k, v in asdict(self).items() if v is not None and k not in unused}


def mismatch(needed: Contract, start: Start) -> str:
    """The first difference to an episode with both values, or ""."""
    line = "{}: the policy has {}, the evaluation {}".format
    names = needed.actions.names(start.action_names)
    if needed.action_names not in (None, names):
        both = (needed.action_names or (), names)
        return line("action names", *(f"{len(n)} ({line_of_text(' '.join(n))})" for n in both))
    if needed.rate not in (None, start.fps):
        rates = f"{needed.rate} Hz", f"{start.fps} Hz"
        return line("control rate", *rates) + f": add --fps {needed.rate}"
    if (needed.chunk or 0) > LONGEST_CHUNK:
        return line("chunk size", needed.chunk, LONGEST_CHUNK)
    for camera, size in (needed.image_sizes or {}).items():
        name, shown = line_of_text(camera), start.image_sizes.get(camera)
        if shown is None:
            ours = line_of_text(", ".join(start.image_sizes)) or "none"
            return line("cameras", name, ours) + ": name it in --cameras"
        if tuple(size) != tuple(shown):
            theirs, ours = (f"{width}x{height}" for height, width in (size, shown))
            return line(f"image size of {name}", theirs, ours) + f": add --size {theirs}"
    return ""


def declared(policy: Policy) -> dict[str, Any]:
    setup = attribute(policy, "setup")
    if isinstance(setup, Setup):
        return {key: getattr(setup, key) for key in INTERFACE}
    keys = dict(setup) if isinstance(setup, Mapping) else {}
    for key, kind in (("fps", int), ("cameras", list | tuple), ("size", list | tuple)):
        if isinstance(value := attribute(policy, key), kind):
            keys[key] = value
    try:
        setup = Setup.parse(keys, "the policy's setup")
    except RecipeError as error:
        raise PolicyError(str(error)) from error
    return {key: getattr(setup, key) for key in INTERFACE if key in keys}


def plain(keys: Mapping[str, Any]) -> dict[str, Any]:
    values = Setup(**keys).model_dump(mode="json")
    return {key: value for key, value in values.items() if key in keys}


def difference(needed: Mapping[str, Any], given: Setup) -> str:
    """One line about the first key that differs, or "". More than the policy needs may be shown."""
    for key, value in needed.items():
        ours = getattr(given, key)
        if key == "cameras":
            fits = set(value) <= set(ours)
        elif key == "size":
            fits = value == ours or not given.cameras
        else:
            fits = value == ours or ours is True
        if not fits:
            written, shown = _write_option(value), _write_option(ours)
            helps = option_of(key) if value is True else f"{option_of(key)} {written}"
            line = f"{key}: the policy has {written}, the evaluation {shown}"
            return f"{line}: add {helps}, or --like its dataset"
    return ""


def check_contract(policy: Policy, start: Start) -> None:
    """Compare a policy's interface with an episode. Raises PolicyError."""
    contract = attribute(policy, "contract")
    reason = difference(declared(policy), start.setup)
    if not reason and isinstance(contract, Mapping):
        reason = f"the policy's contract is a {type(contract).__name__}: make it a Contract"
    if not reason and isinstance(contract, Contract):
        reason = mismatch(contract, start)
    if reason:
        raise PolicyError(reason)


def actions_of(policy: Policy) -> Representation:
    """Joint targets by default. Raises PolicyError."""
    contract = attribute(policy, "contract")
    return contract.actions if isinstance(contract, Contract) else JOINTS


def begin(policy: Policy, start: Start) -> None:
    """Reset a policy, with the `action_names` of its representation. Raises what it raises."""
    names = actions_of(policy).names(start.state_names)
    policy.reset(replace(start, action_names=names))


def check_actions(policy: Policy, given: Representation | None) -> None:
    if given is None or not isinstance(attribute(policy, "contract"), Contract):
        return
    if (theirs := actions_of(policy)) != given and theirs.describe() != given.describe():
        both = (", ".join(astuple(each)) for each in (theirs, given))
        fix = "correct the contract, or give --like the dataset"
        raise PolicyError("actions: the policy has {}, the evaluation {}: ".format(*both) + fix)


def action_length(policy: Policy, action_names: Sequence[str]) -> int:
    return len(actions_of(policy).names(action_names))


def _write_option(value: Any) -> str:
    if isinstance(value, tuple) and value and isinstance(value[0], int):
        return f"{value[0]}x{value[1]}"
    if isinstance(value, tuple):
        return ",".join(map(camera_name, value)) or "none"
    return "none" if value is None else str(value)
