"""Results on disk: one JSON line an episode."""

import json
import os
from collections.abc import Callable, Hashable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationError, create_model

from pipeline.data.errors import DominoError
from pipeline.data.parsing import first_fault, parse_json
from pipeline.data.reading import read_regular
from pipeline.evaluate.lines import line_of_text

EPISODES = "episodes.jsonl"

_TEXTS = (
    *("key", "policy", "probe", "clock", "rules"),
    *("task", "embodiment", "domain", "category", "failure"),
)
_NUMBERS = ("level", "alpha", "seed", "route_completion", "manipulation_score")
_FIELDS: dict[str, Any] = {
    **dict.fromkeys(_TEXTS, (str, ...)),
    **dict.fromkeys(("success", "same_start", "sees_truth"), (bool, ...)),
    **dict.fromkeys(_NUMBERS, (Annotated[float, Field(ge=0, lt=1e12)], ...)),
    **dict.fromkeys(("failed", "penalties"), (list[str], ...)),
    "benchmark": (str, ""),
}
_Stated = create_model("_Stated", __config__=ConfigDict(strict=True), **_FIELDS)


class ResultsError(DominoError): ...


TIMES = "seconds_spent"  # differs between runs of one episode


class Results:
    """An append-only file of rows with the key of their episode under "key".

    A last line that was cut off is dropped. Raises ResultsError for a damaged line elsewhere,
    and for rows of one episode that contradict each other."""

    def __init__(
        self, path: Path, check: Callable[[dict[str, Any]], None] = lambda row: None
    ) -> None:
        self.path = path
        self._rows: dict[str, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        text = read_regular(path) if path.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                row = parse_json(line)
                if not isinstance(row, dict) or not isinstance(row.get("key"), str):
                    raise ValueError("it has no key")
                check(row)
            except ValueError as error:
                what = f"{path}: line {number} is no result ({line_of_text(error)})"
                raise ResultsError(f"{what}: repair or delete it") from error
            known = self._rows.setdefault(row["key"], row)
            if {**known, TIMES: None} != {**row, TIMES: None}:
                raise ResultsError(f"{path}: line {number} contradicts an earlier row: delete one")
        if len(whole) < len(text):
            os.truncate(path, len(whole))
        self._size = len(whole)

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def append(self, key: str, row: Mapping[str, Any]) -> None:
        """Add a row; it is on disk when this returns. Raises OSError, ResultsError."""
        stored = {"key": key, **row}
        with open(self.path, "ab") as file:
            if file.tell() != self._size:
                raise ResultsError(f"{self.path}: something else writes to it: remove its lines")
            self._size += file.write(json.dumps(stored, separators=(",", ":")).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._rows[key] = stored

    def rows(self) -> list[dict[str, Any]]:
        return list(self._rows.values())

    def of(self, keys: Iterable[str]) -> list[dict[str, Any]]:
        return [self._rows[key] for key in keys if key in self._rows]


def check_episode(row: dict[str, Any]) -> None:
    """Raise ValueError, naming the field, for what is no row of any version."""
    row.setdefault("probe", "")
    try:
        _Stated.model_validate(row)
    except ValidationError as error:
        raise ValueError(first_fault(error)) from error
    key = parse_json(row["key"])
    texts = key[:5] if isinstance(key, list) and len(key) == 6 else [None]
    if not all(isinstance(part, str) for part in texts):
        raise ValueError("key is no key of an episode")


def text_key(key: Hashable) -> str:
    return json.dumps(key, separators=(",", ":"))
