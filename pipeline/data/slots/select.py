"""`--where "level=3 and task in (click_bell, press_stapler)"`: an expression over COLUMNS, which
becomes one of pyarrow.
"""

import hashlib
import operator
import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import reduce
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, real, show_value, whole
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Bools

from .records import PLACE

LONGEST = 4000  # characters; trees of more could exhaust the stack

MOST_WHOLE = 2**63 - 1

_ARROW = {str: pa.string(), int: pa.int64(), float: pa.float64()}
_RECORDED = {"outcome": str, "attempt": int, "stage": str, "reason": str, "detail": str}
_TIMED = {"sim_steps": int, "seconds": float}


def _kinds_of(record: type) -> dict[str, type]:
    """The fields that are, or may be, a text or a number."""
    kinds = dict[str, type]()
    for name, hint in get_type_hints(record).items():
        hint = getattr(hint, "__value__", hint)  # of an alias
        choices = get_args(hint) if get_origin(hint) in (Literal, UnionType) else (hint,)
        for kind in _ARROW:
            if kind in choices or isinstance(choices[0], kind):
                kinds[name] = kind
    return kinds


COLUMNS: dict[str, type] = {
    **_kinds_of(EpisodeSpec),
    **{"pair": str, "T_meet": float, "split": str, "length": int},
    **_RECORDED,
    **_TIMED,
    **_kinds_of(EpisodeMeta),
}
"""Types of columns: the spec of an episode, its meeting (s), split and frames, its attempt, and
what its file states."""

_SCHEMA = pa.schema([(name, _ARROW[kind]) for name, kind in COLUMNS.items()])
_COMPARE = {
    **{"=": operator.eq, "==": operator.eq, "!=": operator.ne},
    **{"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
}
_SIGNS = {*_COMPARE, *"(),", "and", "or", "not", "in"}
_WORD = re.compile(r"""(==|!=|<=|>=|[=<>(),]|"[^"]*"|'[^']*'|[\w.+-]+)\s*""")

type Attempts = Mapping[tuple[Any, ...], Mapping[str, Any]]  # other columns by place and seed
type Words = deque[str]  # the rest of an expression: columns, values as written, signs


class WhereError(DominoError):
    """An expression that cannot be read."""


class _Unreadable(ValueError):
    """What is wrong with it, without its text."""


VALIDATION, TEST = 0.1, 0.1
"""Shares of physics episodes in these splits."""


def position_of(physics_id: str) -> float:
    """A number in [0, 1): the first 8 bytes of the SHA-256 of the id, big-endian, over 2**64."""
    return int.from_bytes(hashlib.sha256(physics_id.encode()).digest()[:8]) / 2**64


def split_of(physics_id: str, validation: float = VALIDATION) -> str:
    """ "validation" up to that share of positions, then "test", then "train"."""
    ends = {"validation": validation, "test": validation + TEST}
    position = position_of(physics_id)
    return next((name for name, end in ends.items() if position < end), "train")


def attempts_of(attempt_rows: Callable[..., list[dict[str, Any]]]) -> Attempts:
    """A dataset's attempts from its `attempt_rows`, by place and seed."""
    key = (*PLACE, "seed")
    rows = attempt_rows(*key, *_RECORDED, *_TIMED)
    return {tuple(row[name] for name in key): row for row in rows}


def columns_of(
    file: EpisodeFile, attempts: Attempts, validation: float = VALIDATION
) -> dict[str, Any]:
    """COLUMNS of an episode, and of its attempt if it is one."""
    spec, meta = file.spec, file.meta
    place = tuple(getattr(spec, name) for name in (*PLACE, "seed"))
    failure = meta.failure.model_dump() if meta.failure else {}
    return {
        **asdict(spec),
        "pair": spec.pair,
        **{name: getattr(meta, name) for name in EpisodeMeta.model_fields if name in COLUMNS},
        "T_meet": meta.meeting_time,
        "split": split_of(spec.pair or meta.physics_id or spec.to_json(), validation),
        "length": len(file),
        **{"outcome": "failed" if meta.failure else "accepted", **failure},
        **attempts.get(place, {}),
    }


def select_rows(rows: Sequence[Mapping[str, Any]], where: pc.Expression) -> Bools:
    """Which (N,) of the episodes with these columns an expression selects."""
    table = pa.Table.from_pylist([*map(dict, rows)], _SCHEMA).append_column(
        "row", pa.array(range(len(rows)))
    )
    chosen = np.zeros(len(rows), bool)
    chosen[table.filter(where)["row"].to_numpy()] = True
    return chosen


def values_in(rows: Sequence[Mapping[str, Any]], where: str) -> str:
    """What the text columns in an expression hold: "embodiment is aloha-agilex; none has arm"."""
    named = [n for n, kind in COLUMNS.items() if kind is str and re.search(rf"\b{n}\b", where)]
    found = {name: sorted({str(row[name]) for row in rows if row.get(name)}) for name in named}
    return "; ".join(
        f"{n} is {' or '.join(v[:8])}" if v else f"none has {n}" for n, v in found.items()
    )


def parse_where(text: str) -> pc.Expression:
    """The pyarrow expression of a text. Raises WhereError."""
    try:
        words = _split(text)
        found = _either(words)
        if words:
            raise _Unreadable(f"did not expect {' '.join(words)[:40]!r}; join tests with and / or")
    except (_Unreadable, RecursionError) as error:
        what = str(error) if isinstance(error, _Unreadable) else "is nested too deeply"
        shown = text if len(text) <= 200 else text[:200] + "..."
        raise WhereError(f"--where {shown!r}: {what}") from error
    return found


def expression(where: str | None, embodiments: Sequence[str]) -> str:
    """One text from `--where` and `--embodiment`. Raises WhereError."""
    given = "" if where is None else where.strip()
    if where is not None:
        parse_where(where)
    robots = ", ".join(f'"{name}"' for name in embodiments)
    of_robots = f"embodiment in ({robots})" if robots else ""
    return f"{of_robots} and ({given})" if of_robots and given else of_robots or given


def _split(text: str) -> Words:
    if not text.strip():
        raise _Unreadable("is empty: leave it out to take all episodes")
    if len(text) > LONGEST:
        raise _Unreadable(f"has {len(text)} characters, more than {LONGEST}")
    words, rest = deque[str](), text.strip()
    while rest:
        if (word := _WORD.match(rest)) is None:
            quoted = rest[0] in "\"'"
            missing = f"wants {rest[0]} at the end of {rest[:40]!r}"
            raise _Unreadable(missing if quoted else f"cannot read {rest[:12]!r}")
        words.append(word[1])
        rest = rest[word.end() :]
    return words


def _take(words: Words, *wanted: str) -> str:
    """The next word if it is one of these, else ""."""
    return words.popleft() if words and words[0] in wanted else ""


def _either(words: Words) -> pc.Expression:
    found = _both(words)
    while _take(words, "or"):
        found |= _both(words)
    return found


def _both(words: Words) -> pc.Expression:
    found = _one(words)
    while _take(words, "and"):
        found &= _one(words)
    return found


def _one(words: Words) -> pc.Expression:
    if _take(words, "not"):
        return ~_one(words)
    if not _take(words, "("):
        return _test(words)
    found = _either(words)
    if not _take(words, ")"):
        raise _Unreadable(f"wants ')' before {' '.join(words)[:40]!r}" if words else "wants ')'")
    return found


def _test(words: Words) -> pc.Expression:
    """`column in (values)`, or comparisons, which may be chained: 2 < level <= 3."""
    left, is_not, tests = _operand(words), _take(words, "not"), list[pc.Expression]()
    if _take(words, "in"):
        return ~_among(left, words) if is_not else _among(left, words)
    while sign := _take(words, *_COMPARE):
        right = _operand(words)
        tests.append(_compare(left, sign, right))
        left = right
    if is_not or not tests:
        raise _Unreadable(f"{left!r} is no test: compare a column with a value, such as level=1")
    return reduce(operator.and_, tests)


def _operand(words: Words) -> str:
    if not words or words[0] in _SIGNS:
        before = f", not {words[0]!r}" if words else ", and ends"
        raise _Unreadable(f"wants a column or a value{before}")
    return words.popleft()


def _among(column: str, words: Words) -> pc.Expression:
    values, sign = list[str | int | float](), _take(words, "(")
    while sign and not (values and sign == ")"):
        values.append(_value(_operand(words), column))
        sign = _take(words, ",", ")")
    if not sign:
        raise _Unreadable(f"wants values in brackets: {column} in (one, another)")
    return pc.field(column).isin(pa.array(values, _ARROW[COLUMNS[column]]))


def _compare(left: str, sign: str, right: str) -> pc.Expression:
    swapped = left not in COLUMNS and right in COLUMNS
    column, word = (right, left) if swapped else (left, right)
    sides = pc.field(column), pc.scalar(_value(word, column))
    if COLUMNS[column] is str and sign not in ("=", "==", "!="):
        raise _Unreadable(f"{column} is a text, which has no order: use =, != or in")
    return _COMPARE[sign](*(reversed(sides) if swapped else sides))


def _value(word: str, column: str) -> str | int | float:
    if column not in COLUMNS:
        raise _Unreadable(f"{column!r} is no column (columns: {', '.join(COLUMNS)})")
    if word in COLUMNS:
        raise _Unreadable(f"{word!r} is no value for {column}; quote it if it is meant as one")
    text, kind = word[1:-1] if word[0] in "\"'" else word, COLUMNS[column]
    try:
        if kind is int:
            return whole(re.sub(r"\.0*$", "", text), -MOST_WHOLE, MOST_WHOLE)
        return text if kind is str else real(text)
    except ParseError as error:
        raise _Unreadable(f"{column} {show_value(text)} {error}") from None
