"""Policies by name: built-in ones, and files with a function `make_policy()`.

Up to a colon a name may be a kind of policy of FORMS, which is given the whole name. Modules that
distributions announce in the entry points GROUP add to both registries.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from importlib import import_module
from importlib.metadata import entry_points
from inspect import getsource, signature
from pathlib import Path
from typing import Any, Protocol

from pipeline.data.errors import DominoError
from pipeline.data.parsing import real
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.policies.files import digest_of, expected_actions, module_of, name_actions
from pipeline.evaluate.policies.lerobot import LerobotForm
from pipeline.evaluate.policies.policy import NoAnswer, Policy, PolicyError, PolicyName
from pipeline.evaluate.policies.reference import (
    Chaser,
    Interceptor,
    Random,
    ReplayPolicy,
    Static,
    Still,
    Tapper,
)
from pipeline.evaluate.policies.robotwin import RobotwinForm
from pipeline.evaluate.policies.xpolicylab import XPolicyLabForm
from pipeline.evaluate.serving.bridges import groot, starvla
from pipeline.evaluate.serving.client import SCHEMES, BridgeForm, Client, ServerForm
from pipeline.evaluate.serving.process import Process
from pipeline.registry import Registry

POLICIES = Registry[Callable[..., Policy]]("policy")
"""Built-in policies by name; their keyword arguments are numbers."""

IN_PROCESS = Registry[Callable[[], Policy]]("policy of this process")
"""Classes and functions that make policies, by the text of their names."""
GROUP = "domino_data.policies"

MOST = 10_000
"""No argument of a built-in policy (m, s, actions) is larger."""


class Form(Protocol):
    """A kind of policy that is named KIND:..."""

    def name(self, text: str) -> PolicyName:
        """Check that the policy exists, without making it, and name its process. Raises
        PolicyError."""
        ...

    def make(self, text: str) -> Policy:
        """The policy. Raises PolicyError."""
        ...


FORMS = Registry[Form]("kind of policy")
"""Kinds of policies by what stands before the colon."""

for _name, _policy in (
    ("replay", ReplayPolicy),
    ("static", Static),
    ("chaser", Chaser),
    ("tapper", Tapper),
    ("interceptor", Interceptor),
    ("random", Random),
    ("still", Still),
):
    POLICIES.add(_name, _policy)

for _name, _form in (
    *((scheme, ServerForm()) for scheme in SCHEMES),
    ("starvla", BridgeForm(starvla.StarvlaClient, starvla.PORT, starvla.OPTIONS)),
    ("gr00t", BridgeForm(groot.GrootClient, groot.PORT, ("execute",))),
    ("robotwin", RobotwinForm()),
    ("xpolicylab", XPolicyLabForm()),
    ("lerobot", LerobotForm()),
):
    FORMS.add(_name, _form)


STATED = ("lerobot", "starvla", "gr00t", *SCHEMES)
"""Kinds whose names may say what an action is; the others say it in a contract."""


@cache
def load_entry_points() -> None:
    """Import the modules of the entry points GROUP. Raises PolicyError."""
    for point in entry_points(group=GROUP):
        try:
            import_module(point.module)
        except Exception as error:
            what = f"entry point {point.name}: {point.module} cannot be imported"
            raise PolicyError(f"{what}: {line_of(error)}") from error


def policy_name(text: str, prints: Path | None = None, like: Path | None = None) -> PolicyName:
    """Check that a policy exists, without making it. In a process of its own it prints to the end
    of the file `prints`. `like` is an export that says what an action is: told to a kind of STATED,
    and a contract must say the same. Raises PolicyError."""
    load_entry_points()
    kind = text.partition(":")[0]
    if kind in STATED:
        text = name_actions(text, like)
    if kind in FORMS:
        name = FORMS[kind].name(text)
        name = replace(name, actions=expected_actions(text) if kind in STATED else None)
        return replace(name, prints=prints) if name.process == "own" else name
    if text.endswith(".py"):
        path = Path(text).resolve()
        actions = expected_actions(name_actions("", like))
        return PolicyName(
            str(path), f"{path.name}@{digest_of([path])}", prints=prints, actions=actions
        )
    if kind not in POLICIES:
        known = ", ".join([*POLICIES, *(f"{form}:..." for form in FORMS)])
        raise PolicyError(f"--policy {text!r} is unknown: give a file FILE.py or one of {known}")
    _, arguments = _arguments(text)
    known = list(signature(POLICIES[kind]).parameters)
    if unknown := [key for key in arguments if key not in known]:
        raise PolicyError(
            f"--policy {text}: {kind} has no {unknown[0]}; it takes {', '.join(known) or 'nothing'}"
        )
    return PolicyName(text, text, process="evaluator")


def in_process(make: Callable[[], Policy]) -> PolicyName:
    """The name of a policy that a class or function of this process makes, labelled with a hash of
    its source text. No other process can make it. Raises PolicyError without a source text."""
    name = getattr(make, "__name__", type(make).__name__)
    try:
        label = f"{name}@{sha256(getsource(make).encode()).hexdigest()[:8]}"
    except (OSError, TypeError) as error:
        fix = "save it as FILE.py with make_policy() and name that"
        raise PolicyError(f"policy {name}: has no source text ({error}): {fix}") from error
    text = f"{label}-{id(make)}"  # one of the same text may hold other weights
    if text not in IN_PROCESS:
        IN_PROCESS.add(text, make)
    return PolicyName(text, label, process="evaluator")


def is_ours(text: str) -> bool:
    """Whether the text names one of POLICIES, and no file, directory or server."""
    kind = text.partition(":")[0]
    return kind in POLICIES and kind not in FORMS and not text.endswith(".py")


def is_built_in(name: PolicyName) -> bool:
    """Whether a policy is one of POLICIES, which the version of this program covers."""
    return is_ours(name.text) and name.process == "evaluator"


def make_policy(name: PolicyName) -> Policy:
    """The policy of a name, in its process. Raises PolicyError, whatever its own code raises."""
    if name.process != "own":
        return make_here(name)
    try:
        return Client(partial(Process, name))
    except NoAnswer as error:
        raise PolicyError(f"--policy {name.text}: {error}") from error


def make_here(name: PolicyName) -> Policy:
    """The policy of a name in this process. Raises PolicyError as `make_policy`."""
    try:
        return _make(name)
    except (DominoError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PolicyError(f"--policy {name.text}: cannot be made: {line_of(error)}") from error


def _make(name: PolicyName) -> Policy:
    load_entry_points()
    kind = name.text.partition(":")[0]
    if kind in FORMS:
        return FORMS[kind].make(name.text)
    if name.text in IN_PROCESS:
        return IN_PROCESS[name.text]()
    if not name.text.endswith(".py"):
        built_in, arguments = _arguments(name.text)
        return POLICIES[built_in](**arguments)
    maker = getattr(module_of(Path(name.text)), "make_policy", None)
    if not callable(maker):
        raise PolicyError(f"{name.text}: has no function make_policy() that returns a policy")
    policy: Any = maker()
    for method in ("reset", "act"):
        if not callable(getattr(policy, method, None)):
            made = f"make_policy() returned a {type(policy).__name__}"
            raise PolicyError(f"{name.text}: {made} without a method {method}")
    return policy


def _arguments(text: str) -> tuple[str, dict[str, float]]:
    """ "interceptor:noise=0.01,delay=0.1" as a name and numbers."""
    name, _, rest = text.partition(":")
    try:
        pairs = [part.split("=") for part in rest.split(",") if part]
        return name, {key: real(value, 0, MOST) for key, value in pairs}
    except ValueError as error:
        form = f"name:key=number,key=number, each from 0 to {MOST}"
        raise PolicyError(f"--policy {text!r}: write arguments as {form}") from error
