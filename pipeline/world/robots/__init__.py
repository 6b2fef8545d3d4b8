"""The embodiments, by name. `get_embodiment("piper+franka-panda")` pairs a left piper with a right franka-panda."""

from collections.abc import Callable
from functools import cache

from pipeline.world.robots import aloha_agilex
from pipeline.world.robots.contract import Embodiment

EMBODIMENTS: dict[str, Callable[[], Embodiment]] = {
    "aloha-agilex": aloha_agilex.embodiment,
}

ALIASES = {
    "aloha": "aloha-agilex",
    "cobot-magic": "aloha-agilex",
}


class UnknownEmbodiment(ValueError):
    """A name that no embodiment has; the message lists those that exist."""

    def __init__(self, name: str) -> None:
        super().__init__(f'no embodiment {name!r}: choose {", ".join(EMBODIMENTS)} or a pair "left+right" of these')


@cache
def get_embodiment(name: str) -> Embodiment:
    """The embodiment of a name, an alias (any case, `_` for `-`) or a pair "left+right". Raises UnknownEmbodiment."""
    key = name.strip().lower().replace("_", "-")
    key = ALIASES.get(key, key)
    if key not in EMBODIMENTS:
        raise UnknownEmbodiment(name)
    return EMBODIMENTS[key]()


__all__ = ["ALIASES", "EMBODIMENTS", "UnknownEmbodiment", "get_embodiment"]
