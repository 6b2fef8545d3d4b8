"""Instructions from templates with slots, filled with true descriptions.

In "Press {bell} with {arm}." a slot names a body or the role of an arm; {bell:moving} adds an
adjective; {choice} is a bare word. A template that begins with "~" applies to moving targets only.
"""

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import combinations, product
from pathlib import Path
from string import Formatter

import numpy as np

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
    for an unknown slot, and if no template of a split is true."""
    drawn = dict[str, list[str]]()
    for split in ("seen", "unseen"):
        words = {name: getattr(each, split) for name, each in wording.objects.items()}
        true = [t for t in getattr(wording, split) if _true(t, wording.arms, wording.moving)]
        fillings = [_fillings(t, words, wording) for t in true]
        drawn[split] = _draw(fillings, split, rng, count)
    return drawn


@lru_cache(maxsize=4096)
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
class _Template:
    """A template without choices, and what may fill its arms and `bodies`."""

    text: str
    arms: Mapping[str, str]
    bodies: Sequence[str]
    filled: Sequence[Sequence[str]]

    def fill(self, descriptions: Iterable[str]) -> str:
        fillers = {**self.arms, **dict(zip(self.bodies, descriptions, strict=True))}

        def filler(slot: re.Match[str]) -> str:
            return " ".join(filter(None, ("the", slot[2], fillers[slot[1]])))

        return sentence(_SLOT.sub(filler, self.text))


def _fillings(template: str, words: Mapping[str, Sequence[str]], wording: Wording) -> _Template:
    """A template with its fillings, without repeated or crowded ones if others exist."""
    arms, choices = wording.arms, wording.choices
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
    filled, traits = _combined(tuple(map(tuple, options)))
    text = _SLOT.sub(lambda slot: choices.get(slot[1], slot[0]), template)
    made = _Template(text, {n: f"{arms[n]} arm" for n in names if n not in words}, bodies, filled)
    heavy = {
        each: crowded(made.fill("x with a x" if trait else "x" for trait in each))
        for each in {*traits}
    }
    light = [f for f, each in zip(filled, traits, strict=True) if not heavy[each]]
    return replace(made, filled=light or filled)


@lru_cache(maxsize=32)
def _combined(
    options: tuple[tuple[str, ...], ...],
) -> tuple[list[tuple[str, ...]], list[tuple[bool, ...]]]:
    """Descriptions of each body, apart in their nouns if possible, and which have a "with"."""
    filled = list(product(*options))
    apart = [f for f in filled if not any(nouns(a) & nouns(b) for a, b in combinations(f, 2))]
    filled = apart or [f for f in filled if len(set(f)) == len(f)] or filled
    return filled, [tuple(" with " in d for d in f) for f in filled]


def crowded(text: str) -> bool:
    return any(_CROWDED.search(clause) for clause in CLAUSE.split(text))


def _draw(
    templates: Sequence[_Template], split: str, rng: np.random.Generator, count: int
) -> list[str]:
    if not templates:
        raise LanguageError(f"no {split} template is true of this scene")
    first = templates[0].fill(templates[0].filled[0])
    several = any(t.fill(f) != first for t in templates for f in t.filled)
    drawn: list[str] = []
    left: list[tuple[_Template, list[int]]] = []
    while True:
        # every filling once, the templates taking turns in a new random order each round
        left = [each for each in left if each[1]] or [
            (template, rng.permutation(len(template.filled)).tolist()) for template in templates
        ]
        for i in rng.permutation(len(left)):
            template, order = left[int(i)]
            text = template.fill(template.filled[order.pop()])
            if several and drawn and text == drawn[-1]:
                continue
            drawn.append(text)
            if len(drawn) == count:
                return drawn
