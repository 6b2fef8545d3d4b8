"""The embodiments by name: "piper", "piper+franka-panda" (left, right), "piper+none"."""

from functools import cache
from pathlib import Path

from pipeline.data.errors import DominoError
from pipeline.data.names import NONE
from pipeline.data.setup.rules import Layout

from .contract import Embodiment, RobotError
from .pairs import ALIASES, MODELS, pair, register, register_all

OURS = Path(__file__).parents[2] / "assets" / "robots"

register_all(OURS)


class UnknownEmbodiment(DominoError):
    """A name that no embodiment has."""

    def __init__(self, name: str) -> None:
        super().__init__(
            f'no embodiment {name!r}: choose {", ".join(MODELS)} or a pair "left+right" of these,'
            ' one of which may be "none"'
        )


def canonical_name(name: str) -> str:
    """Registry name of a name, alias (any case, `_` for `-`) or pair. Raises UnknownEmbodiment."""
    parts = []
    for part in name.split("+"):
        key = part.strip().lower().replace("_", "-")
        key = ALIASES.get(key, key)
        if key not in MODELS and key != NONE:
            raise UnknownEmbodiment(name)
        parts.append(key)
    if len(parts) > 2 or parts[0] == parts[-1] == NONE:
        raise UnknownEmbodiment(name)
    return parts[0] if len(set(parts)) == 1 else "+".join(parts)


def get_embodiment(name: str, layout: Layout = "ours") -> Embodiment:
    """The embodiment, built once per process, bases at our places or the original's. Raises
    UnknownEmbodiment and RobotError."""
    return _build(canonical_name(name), layout)


@cache
def _build(name: str, layout: Layout) -> Embodiment:
    left, _, right = name.partition("+")
    return pair(MODELS.get(left), MODELS.get(right or left), layout)
