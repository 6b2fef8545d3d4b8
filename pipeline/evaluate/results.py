"""Results on disk: one JSON line an episode, appended as it ends, so that a killed evaluation goes on where it stopped."""

import json
import os
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any

from pipeline.data.errors import DominoError


class ResultsError(DominoError):
    """A file of results that cannot be used."""


class Results:
    """An append-only file of rows; every row carries the key of its episode under "key".

    A last line that was cut off when its writer was killed is dropped. Raises ResultsError for a damaged line elsewhere.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._rows: dict[str, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        text = path.read_bytes() if path.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                row = json.loads(line)
                self._rows[row["key"]] = row
            except (ValueError, TypeError, KeyError) as error:
                raise ResultsError(f"{path}: line {number} is no result: repair or delete it") from error
        if len(whole) < len(text):
            os.truncate(path, len(whole))

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def __getitem__(self, key: str) -> dict[str, Any]:
        return self._rows[key]

    def append(self, key: str, row: Mapping[str, Any]) -> None:
        """Add the row of an episode; it is on disk when this returns. Raises OSError where the disk refuses."""
        stored = {"key": key, **row}
        with open(self.path, "ab") as file:
            file.write(json.dumps(stored, separators=(",", ":")).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._rows[key] = stored

    def rows(self) -> list[dict[str, Any]]:
        """All rows in the order in which they were first added."""
        return list(self._rows.values())

    def of(self, keys: Iterable[str]) -> list[dict[str, Any]]:
        """The rows of these keys that are there, in this order."""
        return [self._rows[key] for key in keys if key in self._rows]


def text_key(key: Hashable) -> str:
    """A key as one line of text."""
    return json.dumps(key, separators=(",", ":"))
