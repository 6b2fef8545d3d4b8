"""Policies by name: built-in ones, files with `make_policy()`, FORMS, and entry points GROUP."""

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
from pipeline.registry import Registry

from .policies import reference
from .policies.files import digest_of, expected_actions, module_of, name_actions
from .policies.lerobot import LerobotForm
from .policies.policy import NoAnswer, Policy, PolicyError, PolicyName, foreign
from .policies.reactive import Reactive
from .policies.robotwin import RobotwinForm
from .policies.xpolicylab import XPolicyLabForm
from .serving import groot, starvla
from .serving.client import SCHEMES, BridgeForm, Client, ServerForm
from .serving.process import Process

POLICIES = Registry[Callable[..., Policy]]("policy")

IN_PROCESS = Registry[Callable[[], Policy]]("policy of this process")
"""Classes and functions that make policies, by the text of their names."""
GROUP = "domino_data.policies"

MOST = 10_000  # of an argument of a built-in policy (m, s, actions)


class Form(Protocol):
    """A kind of policy that is named KIND:... Raises PolicyError."""

    def name(self, text: str) -> PolicyName: ...

    def make(self, text: str) -> Policy: ...


FORMS = Registry[Form]("kind of policy")

for _name, _policy in (
    ("replay", reference.ReplayPolicy),
    ("static", reference.Static),
    ("chaser", reference.Chaser),
    ("tapper", reference.Tapper),
    ("interceptor", reference.Interceptor),
    ("random", reference.Random),
    ("still", reference.Still),
    ("blind", reference.Blind),
    ("reactive", Reactive),
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
    for point in entry_points(group=GROUP):
        with foreign(f"entry point {point.name}: {point.module} cannot be imported"):
            import_module(point.module)


def policy_name(text: str, prints: Path | None = None, like: Path | None = None) -> PolicyName:
    """The export `like` states what an action is. Raises PolicyError."""
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
        label = f"{path.name}@{digest_of([path])}"
        return PolicyName(str(path), label, prints=prints, actions=actions)
    if kind not in POLICIES:
        known = ", ".join([*POLICIES, *(f"{form}:..." for form in FORMS)])
        raise PolicyError(f"--policy {text!r} is unknown: give a file FILE.py or one of {known}")
    _, arguments = _arguments(text)
    known = list(signature(POLICIES[kind]).parameters)
    if unknown := [key for key in arguments if key not in known]:
        takes = ", ".join(known) or "nothing"
        raise PolicyError(f"--policy {text}: {kind} has no {unknown[0]}; it takes {takes}")
    return PolicyName(text, text, process="evaluator")


def in_process(make: Callable[[], Policy]) -> PolicyName:
    """A class or function, with its source's hash. Raises PolicyError."""
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
    kind = text.partition(":")[0]
    return kind in POLICIES and kind not in FORMS and not text.endswith(".py")


def is_built_in(name: PolicyName) -> bool:
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
    """As `make_policy`, in this process."""
    with foreign(f"--policy {name.text}: cannot be made", known=(DominoError,)):
        return _make(name)


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
            raise PolicyError(f"{name.text}: what make_policy() returned has no method {method}")
    return policy


def _arguments(text: str) -> tuple[str, dict[str, float]]:
    name, _, rest = text.partition(":")
    try:
        pairs = [part.split("=") for part in rest.split(",") if part]
        return name, {key: real(value, 0, MOST) for key, value in pairs}
    except ValueError as error:
        form = f"name:key=number,key=number, each from 0 to {MOST}"
        raise PolicyError(f"--policy {text!r}: write arguments as {form}") from error
