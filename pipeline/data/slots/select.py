"""`--where "level=3 and task in (click_bell, press_stapler)"`: an expression over COLUMNS, which
becomes one of pyarrow.
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
    **{ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt},
    **{ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge},
}
_JOINING = ("and", "or", "not", "in")
_WORD = re.compile(
    r"""(?P<sign>[=!<>]=|[=<>(),]) | (?P<quote>["'])(?P<text>.*?)(?P=quote) | (?P<word>[\w.+-]+)
    | (?P<rest>\S.{0,11})""",
    re.VERBOSE | re.DOTALL,
)

type Attempts = Mapping[tuple[Any, ...], Mapping[str, Any]]  # other columns by place and seed


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
        return _build(ast.parse(_write_python(text), mode="eval").body)
    except (_Unreadable, SyntaxError, RecursionError, MemoryError) as error:
        rule = "join tests such as level=1 with and / or, and write values of in as (one, another)"
        what = str(error) if isinstance(error, _Unreadable) else f"cannot be read: {rule}"
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


def _write_python(text: str) -> str:
    """The expression as Python writes it: columns are names, values are texts."""
    if not text.strip():
        raise _Unreadable("is empty: leave it out to take all episodes")
    if len(text) > LONGEST:
        raise _Unreadable(f"has {len(text)} characters, more than {LONGEST}")
    parts, after_operand = list[str](), False
    for found in _WORD.finditer(text):
        sign, word = found["sign"], found["word"]
        if found["rest"]:
            raise _Unreadable(f"cannot read {found['rest']!r}")
        is_operand = not sign and word not in _JOINING
        if is_operand and after_operand:
            raise _Unreadable(f"did not expect {found[0]!r}; join tests with and / or")
        after_operand = is_operand
        if sign:
            parts.append("==" if sign == "=" else sign)
        else:
            stays = word in COLUMNS or not is_operand
            parts.append(word if stays else repr(word or found["text"]))
    return " ".join(parts)


def _build(node: ast.expr) -> pc.Expression:
    match node:
        case ast.BoolOp(op, tests):
            join = operator.and_ if isinstance(op, ast.And) else operator.or_
            return reduce(join, map(_build, tests))
        case ast.UnaryOp(ast.Not(), test):
            return ~_build(test)
        case ast.Compare(left, signs, others):  # which may be chained: 2 < level <= 3
            return reduce(operator.and_, map(_test, (left, *others), signs, others))
    raise _Unreadable(
        f"{ast.unparse(node)} is no test: compare a column with a value, such as level=1"
    )


def _test(left: ast.expr, sign: ast.cmpop, right: ast.expr) -> pc.Expression:
    if isinstance(sign, ast.In | ast.NotIn):
        column, values = _column(left), right.elts if isinstance(right, ast.Tuple) else [right]
        listed = pa.array([_value(each, column) for each in values], _ARROW[COLUMNS[column]])
        among = pc.field(column).isin(listed)
        return among if isinstance(sign, ast.In) else ~among
    swapped = isinstance(right, ast.Name) and not isinstance(left, ast.Name)
    column, value = _column(right if swapped else left), left if swapped else right
    sides = pc.field(column), pc.scalar(_value(value, column))
    if COLUMNS[column] is str and not isinstance(sign, ast.Eq | ast.NotEq):
        raise _Unreadable(f"{column} is a text, which has no order: use =, != or in")
    return _COMPARE[type(sign)](*(reversed(sides) if swapped else sides))


def _column(node: ast.expr) -> str:
    if not isinstance(node, ast.Name):
        raise _Unreadable(f"{ast.unparse(node)} is no column (columns: {', '.join(COLUMNS)})")
    return node.id


def _value(node: ast.expr, column: str) -> str | int | float:
    if not isinstance(node, ast.Constant):
        shown = ast.unparse(node)
        raise _Unreadable(f"{shown!r} is no value for {column}; quote it if it is meant as one")
    text, kind = str(node.value), COLUMNS[column]
    try:
        if kind is int:
            return whole(re.sub(r"\.0*$", "", text), -MOST_WHOLE, MOST_WHOLE)
        return text if kind is str else real(text)
    except ParseError as error:
        raise _Unreadable(f"{column} {show_value(text)} {error}") from None
