"""The ledger: for every finished slot its keys, the hash of its episode, and all its attempts."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import pyarrow as pa

from pipeline.data.keys import SlotKeys, canonical

ATTEMPTS = pa.schema(
    [
        ("task", pa.string()),
        ("embodiment", pa.string()),
        ("level", pa.int8()),
        ("alpha", pa.float64()),
        ("domain", pa.string()),
        ("slot", pa.int32()),
        ("attempt", pa.int32()),
        ("seed", pa.int64()),
        ("outcome", pa.string()),
        ("stage", pa.string()),
        ("reason", pa.string()),
        ("detail", pa.string()),
        ("conditions", pa.list_(pa.string())),
        ("kept", pa.string()),
        *((name, pa.float64()) for name in ("average_speed", "maximum_speed", "end_speed", "displacement")),
        ("sim_steps", pa.int64()),
        ("seconds", pa.float64()),
    ]
)
"""Columns of attempts.parquet: one row an attempt; `kept` is the sha256 of the file of a failed attempt that is kept, speeds (m/s)
and displacement (m) are those of the motion that was drawn, if any."""

NO_RECORD = (ValueError, TypeError, AttributeError, KeyError)
"""What reading an entry raises that is none."""

SHA256 = re.compile("[0-9a-f]{64}")
_LARGEST_WHOLE = 2**53  # beyond it not every whole number is a float64


def _fits(column: str, value: Any) -> bool:
    """Whether a value can stand in a column of ATTEMPTS as it is."""
    kind = ATTEMPTS.field(column).type if column in ATTEMPTS.names else None
    if kind == pa.string():
        return isinstance(value, str)
    if kind == pa.list_(pa.string()):
        return isinstance(value, list) and all(isinstance(each, str) for each in value)
    if isinstance(value, bool) or kind is None:
        return False
    if kind == pa.float64():
        return math.isfinite(value) if isinstance(value, float) else isinstance(value, int) and abs(value) <= _LARGEST_WHOLE
    return isinstance(value, int) and -(2 ** (kind.bit_width - 1)) <= value < 2 ** (kind.bit_width - 1)


@dataclass(frozen=True)
class FileFacts:
    """What the ledger knows of an episode file without opening it: its length in bytes, its frames (0 = unknown), its assets.

    `stamp` is the file's when it was last seen intact (data/ledger/stamps.py; "" = unknown); each asset comes with its own stamp.
    """

    size: int = 0
    stamp: str = ""
    frames: int = 0
    assets: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SlotRecord:
    """The ledger entry of a finished slot: its keys, whether it was accepted, the episode's sha256, every attempt as a row of
    ATTEMPTS, and seconds by phase. `source` is the sha256 of the episode file whose state log the images were drawn from, where
    that is another one; its attempts stand with variant 0. `file` says what was seen of the episode file."""

    keys: SlotKeys
    accepted: bool
    sha256: str
    attempts: tuple[dict[str, Any], ...]
    phases: dict[str, float]
    source: str = ""
    file: FileFacts = field(default_factory=FileFacts)

    def to_json(self) -> bytes:
        """JSON with sorted keys, in ASCII, without line breaks."""
        values = vars(self) | {"keys": self.keys.to_json(), "attempts": list(self.attempts), "file": asdict(self.file)}
        return json.dumps(values, sort_keys=True, separators=(",", ":")).encode()

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> "SlotRecord":
        """Inverse of `to_json`, for what the text holds. Raises ValueError, TypeError, AttributeError or KeyError for no record."""
        canonical(values)  # refuses infinite numbers and texts that have no UTF-8
        file = FileFacts(**values["file"])
        keys = SlotKeys.from_json(values["keys"])
        record = cls(**(values | {"keys": keys, "attempts": tuple(values["attempts"]), "file": file}))
        record.check()
        return record

    def check(self) -> None:
        """Raise ValueError where the parts cannot be those of one slot."""
        if not isinstance(self.accepted, bool) or not isinstance(self.sha256, str) or not isinstance(self.source, str):
            raise ValueError("accepted is not true or false, or a hash is no text")
        if self.accepted != bool(SHA256.fullmatch(self.sha256)) or (self.sha256 and not self.accepted):
            raise ValueError("a slot has the sha256 of an episode where it was accepted, and only there")
        for row in self.attempts:
            wrong = [name for name, value in row.items() if not _fits(name, value)]
            if wrong or not {"seed", "outcome"} <= set(row):
                raise ValueError(f"an attempt has {wrong[0] if wrong else 'no seed or outcome'}, which is no value of that column")
        if self.attempts and (self.attempts[-1]["outcome"] == "accepted") != self.accepted:
            raise ValueError("its last attempt and the slot do not agree on whether it was accepted")
