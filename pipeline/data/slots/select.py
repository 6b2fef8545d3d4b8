"""`--where "level=3 and task in (click_bell, press_stapler)"`: an expression over COLUMNS.

Python only parses the text; its tree becomes a pyarrow expression. Nothing is evaluated.
"""

import ast
import hashlib
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import reduce
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, real, show_value, whole
from pipeline.data.spec import EpisodeSpec

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
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_KEYWORDS = ("and", "or", "not", "in")
_TOKEN = re.compile(
    r"""\s*(?:(?P<op>==|!=|<=|>=|[=<>(),])|"(?P<dq>[^"]*)"|'(?P<sq>[^']*)'|(?P<word>[\w.+-]+))"""
)
_PLACEHOLDER = re.compile(r"value_\d+")

type Attempts = Mapping[tuple[Any, ...], Mapping[str, Any]]  # other columns by place and seed
type Values = Mapping[str, str]  # what the user wrote by placeholder


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


def select_rows(rows: Sequence[Mapping[str, Any]], where: pc.Expression) -> NDArray[np.bool_]:
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
        if not text.strip():
            raise _Unreadable("is empty: leave it out to take all episodes")
        if len(text) > LONGEST:
            raise _Unreadable(f"has {len(text)} characters, more than {LONGEST}")
        python, values = _as_python(text)
        try:
            tree = ast.parse(python, mode="eval")
        except SyntaxError as error:
            raise _Unreadable(_mistake(python, values, error)) from error
        return _translate(tree.body, values)
    except (_Unreadable, RecursionError, MemoryError) as error:
        what = str(error) if isinstance(error, _Unreadable) else "is nested too deeply"
        shown = text if len(text) <= 200 else text[:200] + "..."
        raise WhereError(f"--where {shown!r}: {what}") from error


def expression(where: str | None, embodiments: Sequence[str]) -> str:
    """One text from `--where` and `--embodiment`. Raises WhereError."""
    given = "" if where is None else where.strip()
    if where is not None:
        parse_where(where)
    robots = ", ".join(f'"{name}"' for name in embodiments)
    of_robots = f"embodiment in ({robots})" if robots else ""
    return f"{of_robots} and ({given})" if of_robots and given else of_robots or given


def _as_python(text: str) -> tuple[str, Values]:
    """`==` for `=`, brackets after `in`, placeholders for values."""
    words: list[str] = []
    values: dict[str, str] = {}
    place, in_list = 0, False
    while text[place:].strip():
        m = _TOKEN.match(text, place)
        if m is None:
            rest = text[place:].strip()
            if rest[0] in "\"'":
                raise _Unreadable(f"wants {rest[0]} at the end of {rest[:40]!r}")
            raise _Unreadable(f"cannot read {rest[:12]!r}")
        place, word = m.end(), m["op"] or m["word"]
        if word == "(" and words[-1:] == ["in"]:
            in_list, word = True, "["
        elif word == ")" and in_list:
            in_list, word = False, "]"
        elif not m["op"] and word not in _KEYWORDS and word not in COLUMNS:
            value = next(v for v in (m["dq"], m["sq"], word) if v is not None)
            word = f"value_{len(values)}"
            values[word] = value
        words.append("==" if word == "=" else word)
    return " ".join(words), values


def _mistake(python: str, values: Values, error: SyntaxError) -> str:
    if "never closed" in error.msg:
        return "wants ')' at the end"
    last = python.split()[-1]
    if last not in values and last not in COLUMNS and last not in (")", "]"):
        return f"ends where something should follow {last!r}"
    rest = _restore_values(python[max((error.offset or 1) - 1, 0) :], values)
    return f"did not expect {rest[:40]!r}; join tests with and / or"


def _restore_values(python: str, values: Values) -> str:
    return _PLACEHOLDER.sub(lambda m: values[m[0]], python).replace("[", "(").replace("]", ")")


def _translate(node: ast.expr, values: Values) -> pc.Expression:
    match node:
        case ast.BoolOp(op=ast.And(), values=parts):
            return reduce(operator.and_, [_translate(part, values) for part in parts])
        case ast.BoolOp(op=ast.Or(), values=parts):
            return reduce(operator.or_, [_translate(part, values) for part in parts])
        case ast.UnaryOp(op=ast.Not(), operand=part):
            return ~_translate(part, values)
        case ast.Compare(left=left, ops=ops, comparators=rights):
            pairs = zip([left, *rights], ops, rights, strict=False)
            return reduce(operator.and_, [_comparison(a, op, b, values) for a, op, b in pairs])
    word = _restore_values(ast.unparse(node), values)
    raise _Unreadable(f"{word!r} is no test: compare a column with a value, such as level=1")


def _comparison(left: ast.expr, op: ast.cmpop, right: ast.expr, values: Values) -> pc.Expression:
    if isinstance(op, ast.In | ast.NotIn):
        field = _field(left, values)
        if not isinstance(right, ast.List) or not right.elts:
            raise _Unreadable(f"wants values in brackets: {field} in (one, another)")
        found = pc.field(field).isin(
            pa.array([_value(v, field, values) for v in right.elts], _ARROW[COLUMNS[field]])
        )
        return ~found if isinstance(op, ast.NotIn) else found
    swapped = ast.unparse(left) in values and ast.unparse(right) in COLUMNS
    column, value = (right, left) if swapped else (left, right)
    field = _field(column, values)
    if COLUMNS[field] is str and not isinstance(op, ast.Eq | ast.NotEq):
        raise _Unreadable(f"{field} is a text, which has no order: use =, != or in")
    sides = pc.field(field), pc.scalar(_value(value, field, values))
    return _COMPARE[type(op)](*(reversed(sides) if swapped else sides))


def _field(node: ast.expr, values: Values) -> str:
    if not isinstance(node, ast.Name) or node.id not in COLUMNS:
        word = _restore_values(ast.unparse(node), values)
        raise _Unreadable(f"{word!r} is no column (columns: {', '.join(COLUMNS)})")
    return node.id


def _value(node: ast.expr, field: str, values: Values) -> str | int | float:
    if not isinstance(node, ast.Name) or node.id not in values:
        shown = _restore_values(ast.unparse(node), values)
        raise _Unreadable(f"{shown!r} is no value for {field}; quote it if it is meant as one")
    word, kind = values[node.id], COLUMNS[field]
    try:
        if kind is int:
            return whole(re.sub(r"\.0*$", "", word), -MOST_WHOLE, MOST_WHOLE)
        return word if kind is str else real(word)
    except ParseError as error:
        raise _Unreadable(f"{field} {show_value(word)} {error}") from None
