"""The English of the library's own instructions; `check-task` asks a stranger's templates alone."""

import re
from collections.abc import Callable
from itertools import combinations

from pipeline.tasks.language.check import MOTION
from pipeline.tasks.language.sentences import CLAUSE, NAMED_ARM, Wording, crowded, nouns, singular

_THEY = re.compile(r"\b(they|them|their|these|those)\b", re.IGNORECASE)
_VAGUE = re.compile(
    r"\bclose the (?:left|right) arm\b|\b(?:in|into|out of) the (?:left|right) arm\b|\bthe"
    r" (?:left|right) arm is to\b"
    r"|\bthe (?:middle|center)\b(?! (?:of|line) )|\b(?:bring|put|lay) (?:them|both|the two|the one)"
    r" (?:together|in|into|inside)\b"
    r"|\bthe one\b.*\bthe other\b|\b(?:lift|raise|hoist|pick up) (?:by|with) the\b|\bthe lot\b",
    re.IGNORECASE,
)
_VERB = re.compile(
    r"\b(?:pick|lift|put|set|take|hold) (?:up|down|off) (?:it|them)\b"
    r"|\b(?:remove|fetch|collect|retrieve)\b(?:(?! and )[^,;:.!?])* off the\b",
    re.IGNORECASE,
)
_MANY = "balls|ends|arms|hands|grippers|fingers|fingertips|contents|sides"
_BARE = (
    "are|were|have|do|be|stand|lie|rest|hang|face|point|sit|"
    "slide|move|travel|go|take|hold|put|lift|lay|carry|place|reach|open"
)
_WITH_S = (
    "is|was|has|does|stands|lies|rests|hangs|faces|points|"
    "sits|slides|moves|goes|takes|holds|puts|lifts|lays|carries|places"
)
_CAUSE = "let|make|have|see|watch"
_WHEN = "while|as|when|once|after|until|before|that|where|which|because|if"

_TWO_ARMS = re.compile(
    r"\b(?:other|second) (?:arm|hand|gripper)\b|\b(?:both|two) (?:of your"
    r" )?(?:arms|hands|grippers)\b|two-handed",
    re.IGNORECASE,
)


def faults(text: str, wording: Wording) -> list[str]:
    """What is wrong with an instruction for a scene, by name."""
    return [name for name, wrong in (CHECKS | GRAMMAR).items() if wrong(text, wording)]


def _find_names(text: str, wording: Wording) -> list[str]:
    names, plain = [], f" {' '.join(re.findall(r'[\w-]+', text.lower()))} "
    for words in wording.objects.values():
        descriptions = [d for d in (*words.seen, *words.unseen) if f" {d.lower()} " in plain]
        names += [max(descriptions, key=len)] if descriptions else []
    return names


def _repeats(text: str, wording: Wording) -> bool:
    """Whether a noun or arm is named twice; "bread" in "bread basket" does not count."""
    known = {noun for d in _find_names(text, wording) for noun in nouns(d)}
    known |= {"button", "handle", "peg", "cap", "ball", "code", "table"}
    tokens = [singular(word) for word in re.findall(r"[\w-]+", text.lower())]
    pairs = zip(tokens, [*tokens[1:], ""], strict=True)
    heads = [word for word, after in pairs if word in known and after not in known]
    arms = [m[0].lower() for m in NAMED_ARM.finditer(text)]
    return len(set(heads)) < len(heads) or len(set(arms)) < len(arms)


def _disagrees(text: str, wording: Wording) -> bool:
    things = [*_find_names(text, wording), "left arm", "right arm"]
    for thing in sorted(things, key=len, reverse=True):
        pattern = rf"(?i)\b(?:the )?(?:\w+ing )?{re.escape(thing)}\b"
        text = re.sub(pattern, "XX", text)
    they = _THEY.search(text)
    if they and not re.search(rf"\b({_MANY}|both|two)\b|XX.*XX", text[: they.start()]):
        return True
    patterns = (
        rf"(?:^|[.;:!?]\s|\b(?:{_WHEN}) )(?:XX|it) (?:{_BARE})\b",
        rf"\b(?:{_CAUSE}) (?:XX|it) (?:{_WITH_S})\b",
        rf"\b(?:{_MANY}) (?:{_WITH_S}|falls|lands|drops)\b",
    )
    return any(re.search(pattern, text, re.IGNORECASE) for pattern in patterns)


def _is_misattached(text: str, wording: Wording) -> bool:
    """Whether "with the left arm" seems to belong to another noun."""
    for clause in CLAUSE.split(text):
        arm = re.search(r" (?:with|using|by means of) the (left|right) arm\b", clause)
        named = [d for d in _find_names(clause, wording) if f" {d} " in f" {clause} "]
        if arm and re.search(
            r" (?:on|onto|in|into|to|over) the (?:(?!and )[\w -])*$", clause[: arm.start()]
        ):
            return True
        if arm and any(
            clause[: arm.start()].endswith(last)
            and first in clause[: arm.start()].removesuffix(last)
            for a, b in combinations(named, 2)
            for first, last in ((a, b), (b, a))
        ):
            return True
    return crowded(text)


def _matches(pattern: str | re.Pattern[str]) -> Callable[[str, Wording], bool]:
    return lambda text, _: bool(re.search(pattern, text))


def _wrong_arm(text: str, wording: Wording) -> bool:
    acting = set(wording.arms.values())
    named = {side.lower() for side in NAMED_ARM.findall(text)}
    return not named <= acting or (len(acting) < 2 and bool(_TWO_ARMS.search(text)))


CHECKS: dict[str, Callable[[str, Wording], bool]] = {
    "slot leak": _matches(r"[{}~_]|\s\s|\s[,;:.!?]|[,;:.!?]{2}|[,;:][^\s]|\A\s|\s\Z"),
    "start or end": _matches(r"\A(?![A-Z].*\w[.!?]\Z)|[.!?]\s+[a-z]"),
    "article": _matches(r"(?i)\b(a [aeiou]\w+|an [^aeiou\W]\w*|(the|an?) (the|an?))\b"),
    "word twice running": _matches(r"(?i)\b(\w+) \1\b"),
    "motion at level 0": lambda text, wording: not wording.moving and bool(MOTION.search(text)),
    "arm": _wrong_arm,
}

GRAMMAR = {
    "repeated noun": _repeats,
    "number": _disagrees,
    "attachment": _is_misattached,
    "vague": lambda text, _: bool(_VAGUE.search(text)),
    "verb": lambda text, _: bool(_VERB.search(text)),
}
