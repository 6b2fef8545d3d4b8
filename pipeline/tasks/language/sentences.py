"""Instructions from templates with slots, filled with true descriptions.

In "Press {bell} with {arm}." a slot names a body or the role of an arm; {bell:moving} adds an
adjective; {choice} is a bare word. A template that begins with "~" applies to moving targets only.
"""

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import combinations, product
from pathlib import Path
from string import Formatter

import numpy as np

from pipeline.data.names import SIDES
from pipeline.world.objects.contract import Words
from pipeline.world.objects.words import LanguageError, two_lists

MOVING = "~"
_SLOT = re.compile(r"\{(\w+)(?::([a-z]+))?\}")
NAMED_ARM = re.compile(r"\b(left|right)[ -](?:arm|hand|gripper)\b", re.IGNORECASE)
_START = re.compile(r"(^|[.!?]\s+)([a-z])")
_PART = re.compile(r"\s+(?:with|of|on|in|made of)\s+")
_SIZE = re.compile(
    r"(?:small|medium-sized|large|little|tiny|short|tall|long|narrow|wide|low|thin|thick|slim|flat|round|square)\b"
)
_CROWDED = re.compile(
    r"\bwith\b.*\b(?:with|[io]n it)\b|\bwith an? (?:(?!the\b)[\w-]+ )+of the\b", re.IGNORECASE
)
CLAUSE = re.compile(r"[,;:.!?]")


def beside(module: str) -> Traversable:
    """The folder of a module, which need not be in a package."""
    package = module.rpartition(".")[0]
    return files(package) if package else Path(getattr(sys.modules[module], "__file__", "")).parent


def has_templates(task: str, module: str) -> bool:
    return beside(module).joinpath(f"phrases/{task}.txt").is_file()


def read_templates(task: str, module: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Seen and unseen templates from phrases/<task>.txt beside the module. Raises LanguageError."""
    where = f"phrases/{task}.txt"
    try:
        text = beside(module).joinpath(where).read_text("utf-8")
    except FileNotFoundError as missing:
        fix = f"give the class `seen` and `unseen` or write {where}"
        raise LanguageError(f"task {task!r} has no templates: {fix}") from missing
    return two_lists(text, where)


@dataclass(frozen=True, eq=False)
class Wording:
    """Templates of one scene, descriptions of `objects` and sides of `arms` by name; `choices` name
    what is asked for."""

    seen: Sequence[str]
    unseen: Sequence[str]
    objects: Mapping[str, Words]
    arms: Mapping[str, str]
    moving: bool = True
    choices: Mapping[str, str] = field(default_factory=dict[str, str])


def instructions(
    wording: Wording, rng: np.random.Generator, count: int = 100
) -> dict[str, list[str]]:
    """Draw `count` instructions for each of the splits "seen" and "unseen".

    No combination of template and descriptions repeats before all were used. Raises LanguageError
    for an unknown slot or side, and if no template of a split is true."""
    for role, side in wording.arms.items():
        if side not in SIDES:
            raise LanguageError(f"arm {role!r} is {side!r}: sides are left and right")
    drawn = dict[str, list[str]]()
    for split in ("seen", "unseen"):
        words = {name: getattr(each, split) for name, each in wording.objects.items()}
        true = [t for t in getattr(wording, split) if _true(t, wording.arms, wording.moving)]
        fillings = [_fillings(t, words, wording.arms, wording.choices) for t in true]
        drawn[split] = _draw(fillings, split, rng, count)
    return drawn


def slots(template: str) -> tuple[str, ...]:
    """The slots of a template, each once, in order. Raises LanguageError for a malformed one."""
    try:
        parts = list(Formatter().parse(template))
    except ValueError as error:
        raise LanguageError(f"{template!r} is malformed: {error}") from error
    fields = [(name, spec, change) for _, name, spec, change in parts if name is not None]
    for name, spec, change in fields:
        if not name.isidentifier() or change or not re.fullmatch("[a-z]*", spec or ""):
            raise LanguageError(f"{template!r} has a slot that is not a plain name: {name!r}")
    return tuple(dict.fromkeys(name for name, _, _ in fields))


def sentence(text: str) -> str:
    """Text with single spaces, capitals and a full stop."""
    text = re.sub(r"\s+", " ", text).strip()
    text = _START.sub(lambda m: m[1] + m[2].upper(), text)
    return text if text.endswith((".", "!", "?")) else text + "."


@lru_cache(maxsize=4096)
def nouns(phrase: str) -> frozenset[str]:
    """Nouns in the singular: "bell" and "base" of "red bell with a black base"."""
    parts = _PART.split(phrase.lower())
    return frozenset(singular(part.split()[-1]) for part in parts if part.strip())


def singular(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def _true(template: str, arms: Mapping[str, str], moving: bool) -> bool:
    if template.startswith(MOVING) and not moving:
        return False
    sides = [arms[name] for name in slots(template) if name in arms]
    if len(set(sides)) < len(sides):
        return False
    return {side.lower() for side in NAMED_ARM.findall(template)} <= set(arms.values())


@dataclass(frozen=True)
class _Filling:
    template: str
    fillers: Mapping[str, str]
    choices: Mapping[str, str]

    def text(self) -> str:
        known = self.choices
        return sentence(
            _SLOT.sub(
                lambda slot: (
                    known[slot[1]]
                    if slot[1] in known
                    else " ".join(filter(None, ("the", slot[2], self.fillers[slot[1]])))
                ),
                self.template,
            )
        )


def _fillings(
    template: str,
    words: Mapping[str, Sequence[str]],
    arms: Mapping[str, str],
    choices: Mapping[str, str],
) -> list[_Filling]:
    """Fillings of a template, without repeated or crowded ones if others exist."""
    template = template.removeprefix(MOVING)
    names = [name for name in slots(template) if name not in choices]
    for name in names:
        if name not in words and name not in arms:
            known = ", ".join(sorted({*words, *arms, *choices}))
            raise LanguageError(f"{template!r} has the slot {{{name}}}: there are {known}")
        if name in words and not words[name]:
            raise LanguageError(f"{template!r} has the slot {{{name}}}, which has no description")
    bodies = [n for n in names if n in words]
    own = frozenset(singular(word) for word in re.findall(r"\w+", _SLOT.sub(" ", template).lower()))
    options = [list(dict.fromkeys(words[n])) for n in bodies]
    options = [[d for d in c if not nouns(d) & own] or c for c in options]
    marked = {m[1] for m in _SLOT.finditer(template) if m[2]}
    options = [
        [d for d in c if n not in marked or not _SIZE.match(d)] or c
        for n, c in zip(bodies, options, strict=True)
    ]
    filled = list(product(*options))
    apart = [f for f in filled if not any(nouns(a) & nouns(b) for a, b in combinations(f, 2))]
    filled = apart or [f for f in filled if len(set(f)) == len(f)] or filled
    roles = {n: f"{arms[n]} arm" for n in names if n not in words}

    def filling(descriptions: Iterable[str]) -> _Filling:
        return _Filling(template, roles | dict(zip(bodies, descriptions, strict=True)), choices)

    # crowded or not by which descriptions have a "with"
    traits = [tuple(" with " in d for d in f) for f in filled]
    heavy = {
        each: crowded(filling("x with a x" if trait else "x" for trait in each).text())
        for each in {*traits}
    }
    light = [f for f, each in zip(filled, traits, strict=True) if not heavy[each]]
    return [filling(f) for f in light or filled]


def crowded(text: str) -> bool:
    return any(_CROWDED.search(clause) for clause in CLAUSE.split(text))


def _draw(
    templates: Sequence[Sequence[_Filling]], split: str, rng: np.random.Generator, count: int
) -> list[str]:
    if not templates:
        raise LanguageError(f"no {split} template is true of this scene")
    first = templates[0][0].text()
    several = any(filling.text() != first for fillings in templates for filling in fillings)
    drawn: list[str] = []
    left: list[list[_Filling]] = []
    while True:
        # every filling once, the templates taking turns in a new random order each round
        left = [fillings for fillings in left if fillings] or [
            [fillings[int(i)] for i in rng.permutation(len(fillings))] for fillings in templates
        ]
        for i in rng.permutation(len(left)):
            text = left[int(i)].pop().text()
            if several and drawn and text == drawn[-1]:
                continue
            drawn.append(text)
            if len(drawn) == count:
                return drawn
