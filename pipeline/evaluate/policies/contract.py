"""What a policy was made for; another evaluation is refused before anything moves.

A policy declares it in `setup` (a Setup, or keys of one), in the attributes `fps`, `cameras` and
`size`, whose values are those of a setup, or in `contract`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, replace
from typing import Any

from pydantic.dataclasses import dataclass

from pipeline.data.actions import JOINTS, Representation
from pipeline.data.setup import INTERFACE, RecipeError, Setup, option_of
from pipeline.data.setup.written import camera_name
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.policy import LONGEST_CHUNK, Policy, PolicyError, Start, attribute


@dataclass(frozen=True)
class Contract:
    """What a policy was made for; None means: anything.

    `action_names` are the joints of state and action in their order; `image_sizes` the (height,
    width) of each camera that is needed; `rate` actions a second; `chunk` the most actions in one
    answer. `representation`, `rotation` and `frame` say what an action is (data/actions.py). The
    others have one value that an evaluation accepts, GIVEN: the policy turns joints and images into
    what its network takes and back, it keeps past observations, and each episode has a seed.
    """

    action_names: tuple[str, ...] | None = None
    image_sizes: Mapping[str, tuple[int, int]] | None = None
    rate: int | None = None
    chunk: int | None = None
    normalization: str = "policy"
    representation: str = JOINTS.actions
    rotation: str = JOINTS.rotation
    frame: str = JOINTS.frame
    history: str = "policy"
    seeds: str = "episode"

    @classmethod
    def of(cls, actions: Representation) -> "Contract":
        """The contract of a policy that says only what its actions are."""
        return cls(representation=actions.actions, rotation=actions.rotation, frame=actions.frame)

    @property
    def actions(self) -> Representation:
        """Raises PolicyError for an unknown word."""
        try:
            return Representation(self.representation, self.rotation, self.frame)
        except ValueError as error:
            raise PolicyError(f"the policy's {line_of_text(str(error))}") from error

    def to_dict(self) -> dict[str, Any]:
        """As plain data, without what is None or unused."""
        unused = () if self.representation != JOINTS.actions else ("rotation", "frame")
        return {k: v for k, v in asdict(self).items() if v is not None and k not in unused}


GIVEN = {"normalization": "policy", "history": "policy", "seeds": "episode"}


def mismatch(needed: Contract, start: Start) -> str:
    """One line that names both values of the first difference to an episode; "" if there is
    none."""
    for key, ours in GIVEN.items():
        if (theirs := getattr(needed, key)) != ours:
            return f"{key}: the policy has {line_of_text(theirs)}, the evaluation {ours}"
    names = needed.actions.names(start.action_names)
    if needed.action_names not in (None, names):
        theirs, ours = (
            f"{len(n)} ({line_of_text(' '.join(n))})" for n in (needed.action_names, names)
        )
        return f"action names: the policy has {theirs}, the evaluation {ours}"
    if needed.rate not in (None, start.fps):
        return (
            f"control rate: the policy has {needed.rate} Hz, the evaluation {start.fps} Hz: add"
            f" --fps {needed.rate}"
        )
    if needed.chunk is not None and needed.chunk > LONGEST_CHUNK:
        return (
            f"chunk size: the policy answers with {needed.chunk} actions, the evaluation takes"
            f" {LONGEST_CHUNK}"
        )
    for camera, size in (needed.image_sizes or {}).items():
        name = line_of_text(camera)
        if camera not in start.image_sizes:
            shown = line_of_text(", ".join(start.image_sizes)) or "none"
            return (
                f"cameras: the policy needs {name}, the evaluation shows {shown}: name it in"
                " --cameras"
            )
        if tuple(size) != tuple(shown := start.image_sizes[camera]):
            theirs, ours = (f"{width}x{height}" for height, width in (size, shown))
            return (
                f"image size of {name}: the policy has {theirs}, the evaluation {ours}: add --size"
                f" {theirs}"
            )
    return ""


def declared(policy: Policy) -> dict[str, Any]:
    """The keys of INTERFACE that a policy declares. Raises PolicyError."""
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
    """Keys of a setup as plain data."""
    values = Setup(**keys).model_dump(mode="json")
    return {key: value for key, value in values.items() if key in keys}


def difference(needed: Mapping[str, Any], given: Setup) -> str:
    """One line that names both values of the first key that differs, and the option that helps, or
    "". The evaluation may show more than the policy needs, but not less."""
    for key, value in needed.items():
        ours = getattr(given, key)
        if key == "cameras":
            fits = set(value) <= set(ours)
        elif key == "size":
            fits = value == ours or not given.cameras
        else:
            fits = value == ours or ours is True
        if not fits:
            written = _write_option(value)
            helps = option_of(key) if value is True else f"{option_of(key)} {written}"
            return (
                f"{key}: the policy has {written}, the evaluation {_write_option(ours)}: add"
                f" {helps}, or --like its dataset"
            )
    return ""


def check_contract(policy: Policy, start: Start) -> None:
    """Compare the declared interface of a policy with an episode. Raises PolicyError."""
    contract = attribute(policy, "contract")
    reason = difference(declared(policy), start.setup)
    if not reason and isinstance(contract, Mapping):
        reason = (
            f"the policy's contract is a {type(contract).__name__}: make it a"
            " pipeline.evaluate.policies.contract.Contract"
        )
    if reason or (isinstance(contract, Contract) and (reason := mismatch(contract, start))):
        raise PolicyError(reason)


def actions_of(policy: Policy) -> Representation:
    """What the actions of a policy are: joint targets unless its contract says otherwise. Raises
    PolicyError."""
    contract = attribute(policy, "contract")
    return contract.actions if isinstance(contract, Contract) else JOINTS


def begin(policy: Policy, start: Start) -> None:
    """Reset a policy; `action_names` become those of the representation that it answers in. Raises
    PolicyError, and what the policy raises."""
    names = actions_of(policy).names(start.state_names)
    policy.reset(replace(start, action_names=names))


def check_actions(policy: Policy, given: Representation | None) -> None:
    """Compare the actions of a contract with those that an export states. Raises PolicyError."""
    if given is None or not isinstance(attribute(policy, "contract"), Contract):
        return
    if (theirs := actions_of(policy)) != given and theirs.describe() != given.describe():
        raise PolicyError(
            f"actions: the policy has {', '.join(astuple(theirs))}, the evaluation"
            f" {', '.join(astuple(given))}: correct the contract, or give --like the dataset"
        )


def action_length(policy: Policy, action_names: Sequence[str]) -> int:
    """Numbers in an action of a policy on a robot with these joints. Raises PolicyError."""
    return len(actions_of(policy).names(action_names))


def _write_option(value: Any) -> str:
    """The value of a key as its option takes it."""
    if isinstance(value, tuple) and value and isinstance(value[0], int):
        return f"{value[0]}x{value[1]}"
    if isinstance(value, tuple):
        return ",".join(map(camera_name, value)) or "none"
    return "none" if value is None else str(value)
