"""Faults of templates, for tests and `check-task`."""

import re
from collections.abc import Collection, Sequence

from .sentences import MOVING, crowded, slots

MOTION = re.compile(
    r"\b(mov(?:es|ing)|on the move|in"
    r" motion|mid-motion|slid(?:es|ing)|glid\w+|drift\w*|travel\w*|pass(?:es|ing)|catch\w*|caught"
    r"|intercept\w*|stop\w*|halt\w*|chas\w+|follow\w*|track\w*|wait\w*|on (?:its|the) way|gets?"
    r" away|goes by|going by|coming|comes"
    r"|approach\w*|cross(?:es|ing)|still (?:mov|slid)\w*|roll(?:s|ing)(?! pin)"
    r"|fall(?:s|ing)(?! in)|drops|fl(?:ies|ying)|flight|tossed)\b",
    re.IGNORECASE,
)
_ARTICLE = re.compile(r"\b(?:the|a|an)\s+\{(\w+)", re.IGNORECASE)
_POSSESSIVE = re.compile(r"\{(\w+)(?::\w+)?\}'s\b")
_SLOT_NAME = re.compile(r"\{\w+")


def check_templates(
    seen: Sequence[str],
    unseen: Sequence[str],
    objects: Collection[str],
    arms: Collection[str],
    choices: Collection[str] = (),
) -> None:
    """Raise ValueError, listing every fault of the templates."""
    splits = (("seen", seen), ("unseen", unseen))
    wrong = [f"no {split} templates" for split, templates in splits if not templates]
    known = {*objects, *arms, *choices}
    met: set[str] = set()
    for template in (*seen, *unseen):
        key = re.sub(r"[^\w{}]+", " ", template).strip().lower()
        if key in met:
            wrong.append(f"{template!r} is given twice")
        met.add(key)
        if any(slot not in choices for slot in _ARTICLE.findall(template)):
            wrong.append(f"{template!r} has an article before a slot")
        for name in _POSSESSIVE.findall(template):
            wrong += [f"{template!r} has the possessive of {{{name}}}"] * (name in objects)
        if crowded(re.sub(r"\{.*?\}", "x", template)):
            wrong.append(f"{template!r} has two phrases with 'with' in one clause")
        try:
            for slot in slots(template):
                if slot not in known:
                    wrong.append(f"{template!r} has the unknown slot {{{slot}}}")
                if len(re.findall(rf"\{{{slot}[}}:]", template)) > 1:
                    wrong.append(f"{template!r} has the slot {{{slot}}} twice")
        except ValueError as error:
            wrong.append(str(error))
        if bool(MOTION.search(_SLOT_NAME.sub(" ", template))) != template.startswith(MOVING):
            fault = "speaks of motion without the mark ~, or has the mark and does not"
            wrong.append(f"{template!r} {fault}")
    if wrong:
        raise ValueError("; ".join(wrong))
