"""The embodiments, by name. `get_embodiment("piper+franka-panda")` pairs a left piper with a right franka-panda."""

from collections.abc import Callable
from functools import cache, partial

from pipeline.world.robots import aloha_agilex, arx_x5, franka_panda, piper, ur5_wsg
from pipeline.world.robots.contract import Embodiment
from pipeline.world.robots.pairs import Model, pair

MODELS: dict[str, Model] = {
    "aloha-agilex": aloha_agilex,
    "arx-x5": arx_x5,
    "franka-panda": franka_panda,
    "piper": piper,
    "ur5-wsg": ur5_wsg,
}

NICKNAMES: dict[str, tuple[str, ...]] = {
    "aloha-agilex": ("aloha", "cobot-magic"),
    "arx-x5": ("arx", "x5"),
    "franka-panda": ("franka", "panda"),
    "piper": ("agilex-piper",),
    "ur5-wsg": ("ur5",),
}

EMBODIMENTS: dict[str, Callable[[], Embodiment]] = {
    name: partial(pair, name, model, model, NICKNAMES[name]) for name, model in MODELS.items()
} | {"aloha-agilex": partial(aloha_agilex.embodiment, NICKNAMES["aloha-agilex"])}

ALIASES = {nickname: name for name, nicknames in NICKNAMES.items() for nickname in nicknames}


class UnknownEmbodiment(ValueError):
    """A name that no embodiment has; the message lists those that exist."""

    def __init__(self, name: str) -> None:
        super().__init__(f'no embodiment {name!r}: choose {", ".join(EMBODIMENTS)} or a pair "left+right" of these')


def canonical_name(name: str) -> str:
    """Registry name of a name, an alias (any case, `_` for `-`) or a pair "left+right". Raises UnknownEmbodiment."""
    found = []
    for part in name.split("+"):
        key = part.strip().lower().replace("_", "-")
        key = ALIASES.get(key, key)
        if key not in EMBODIMENTS:
            raise UnknownEmbodiment(name)
        found.append(key)
    if len(found) > 2:
        raise UnknownEmbodiment(name)
    return found[0] if len(set(found)) == 1 else "+".join(found)


def get_embodiment(name: str) -> Embodiment:
    """The embodiment of a name, an alias or a pair "left+right", built once per process. Raises UnknownEmbodiment."""
    return _build(canonical_name(name))


@cache
def _build(name: str) -> Embodiment:
    if name in EMBODIMENTS:
        return EMBODIMENTS[name]()
    left, right = name.split("+")
    return pair(name, MODELS[left], MODELS[right])


__all__ = ["ALIASES", "EMBODIMENTS", "MODELS", "UnknownEmbodiment", "canonical_name", "get_embodiment"]
