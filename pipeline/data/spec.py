"""One attempt at an episode."""

import hashlib
import json
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from .names import is_embodiment, is_name

HIGHEST_LEVEL = 9  # of any model of motions; which it has, a model tells (motion/models/)
DOMAINS = ("clean", "randomized")

EVENTFUL, CONTROL = "event", "control"
"""The arms of a pair: a scene with its events, and the same scene in which they are withheld."""

MOST_CONDITIONS = 4
"""Events that may be conditions of one scene, which has an arm for every set of them."""


def condition_arms(events: int) -> tuple[str, ...]:
    """The arms of a scene with so many events: a digit for each, 1 if it happens."""
    return tuple(format(number, f"0{events}b") for number in range(1 << events))


@dataclass(frozen=True)
class EpisodeSpec:
    """One attempt at one slot.

    `alpha` is in m/s, `seed` the attempt's own; attempts that share `slot_seed` draw the same for
    it. Slots 2k and 2k + 1 of paired events are the two arms of one scene. Raises ValueError for
    names that are not plain and values out of range.
    """

    task: str
    embodiment: str
    level: int
    alpha: float
    domain: str
    slot: int
    seed: int
    slot_seed: int | None = None
    arm: str = ""

    def __post_init__(self) -> None:
        if not is_name(self.task):
            raise ValueError(f"task {self.task!r}: use letters, digits and single underscores")
        if not is_embodiment(self.embodiment):
            raise ValueError(f"embodiment {self.embodiment!r} is no name, nor two as left+right")
        if self.level not in range(HIGHEST_LEVEL + 1):
            raise ValueError(f"level {self.level!r} is no level: levels are 0 to {HIGHEST_LEVEL}")
        if not (np.isfinite(self.alpha) and self.alpha >= 0):
            raise ValueError(f"alpha {self.alpha!r} is not a speed: give a number >= 0 in m/s")
        if self.domain not in DOMAINS:
            raise ValueError(f"domain {self.domain!r} is unknown: domains are {', '.join(DOMAINS)}")
        if self.slot < 0 or self.seed < 0 or (self.slot_seed or 0) < 0:
            raise ValueError("slot and seeds must not be negative")
        if self.arm and self.arm not in self.arms:
            raise ValueError(f"arm {self.arm!r} is unknown: arms are {EVENTFUL} and {CONTROL}")

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms of the scene that this spec is one arm of; none for a spec of no arm."""
        if self.arm and len(self.arm) <= MOST_CONDITIONS and not {*self.arm} - {*"01"}:
            return condition_arms(len(self.arm))
        return (EVENTFUL, CONTROL) if self.arm else ()

    def withholds(self, event: int) -> bool:
        """Whether this arm withholds the event of that number."""
        return self.arm == CONTROL or self.arm[event : event + 1] == "0"

    @property
    def moving(self) -> bool:
        """Level 0 and alpha 0 are the same static case."""
        return self.level > 0 and self.alpha > 0

    def rng(self, purpose: str) -> np.random.Generator:
        """The named random stream of this attempt. Paired cells share it: level, alpha and
        domain do not enter.
        """
        return self._stream(self.seed, purpose)

    def slot_rng(self, purpose: str) -> np.random.Generator:
        """The named random stream of all attempts with the same `slot_seed`."""
        seed = self.seed if self.slot_seed is None else self.slot_seed
        return self._stream(seed, f"slot/{purpose}")

    def _stream(self, seed: int, purpose: str) -> np.random.Generator:
        slot = self.slot // max(len(self.arms), 1)
        key = json.dumps([self.task, self.embodiment, slot, seed, purpose]).encode()
        return np.random.Generator(
            np.random.Philox(key=int.from_bytes(hashlib.sha256(key).digest()[:16], "little"))
        )

    @property
    def pair(self) -> str:
        """An id (16 hex digits) that the arms of a scene share; "" for none."""
        if not self.arm:
            return ""
        text = replace(self, slot=self.slot // len(self.arms), arm=EVENTFUL).to_json()
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_json(self) -> str:
        """Canonical JSON of `values`."""
        return json.dumps(self.values(), sort_keys=True, separators=(",", ":"))

    def values(self) -> dict[str, Any]:
        """The fields, without an empty arm."""
        return {k: v for k, v in asdict(self).items() if k != "arm" or v}

    @classmethod
    def from_json(cls, text: str) -> "EpisodeSpec":
        """Inverse of `to_json`. Raises ValueError."""
        values = json.loads(text)
        if isinstance(values, dict):
            # episodes of version 0.1 have no slot_seed, those without a pair no arm
            values = {"slot_seed": None, "arm": ""} | values
        names = [f.name for f in fields(cls)]
        if not isinstance(values, dict) or set(values) != set(names):
            raise ValueError(f"is not a spec: its keys must be {', '.join(names)}")
        return cls(**values)


def attempt_seed(recipe_seed: int, cell: str, slot: int, attempt: int) -> int:
    """Seed (63 bits) of an attempt at a slot."""
    key = json.dumps([recipe_seed, cell, slot, attempt]).encode()
    return int.from_bytes(hashlib.sha256(key).digest()[:8], "little") >> 1
