"""Records of finished slots."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa

from pipeline.data.keys import Key, SlotKeys, canonical, digest
from pipeline.data.recipe.cells import Slot, episode_name

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
        *((name, pa.float64()) for name in ("average_speed", "maximum_speed")),
        *((name, pa.float64()) for name in ("end_speed", "displacement")),
        ("sim_steps", pa.int64()),
        ("seconds", pa.float64()),
    ]
)
"""Columns of attempts.parquet. `kept` is the sha256 of a failed attempt's file; speeds (m/s) and
displacement (m) are of the drawn motion."""

PLACE = ("task", "embodiment", "level", "alpha", "domain", "slot")  # columns that name the slot
OF_ATTEMPT = tuple(name for name in ATTEMPTS.names if name not in PLACE)
TIMED = "seconds"  # the column that a clock measured: no file of a slot holds it
MOST_ATTEMPTS = 2_000_000  # rows of attempts.parquet that are read at most


@dataclass(frozen=True)
class FileFacts:
    """What is known of a slot's file without opening it: `size` (bytes), time of change (ns),
    and of an episode more.
    """

    size: int = 0
    changed: int = 0
    frames: int = 0
    physics_id: str = ""
    assets: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        state: os.stat_result,
        frames: int = 0,
        physics_id: str = "",
        assets: Sequence[str] = (),
    ) -> "FileFacts":
        return cls(state.st_size, state.st_mtime_ns, frames, physics_id, tuple(sorted(set(assets))))


@dataclass(frozen=True)
class SlotRecord:
    """A finished slot, with the `sha256` of its episode or of its note, and the wall and processor
    seconds that it took."""

    keys: SlotKeys
    accepted: bool
    sha256: str
    attempts: tuple[dict[str, Any], ...]
    seconds: float = 0.0
    core_seconds: float = 0.0
    file: FileFacts = field(default_factory=FileFacts)


def untimed(attempts: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Attempts without clock times, empty columns, or what the slot states."""
    names = [name for name in OF_ATTEMPT if name != TIMED]
    # numbers may be NumPy's
    empty = (type(None), str, list)
    return [
        {n: row[n] for n in names if row.get(n) or not isinstance(row.get(n), empty)}
        for row in attempts
    ]


def retimed(
    slot: Slot, attempts: Sequence[Mapping[str, Any]], seconds: Mapping[int, float]
) -> tuple[dict[str, Any], ...]:
    """Inverse of `untimed`; `seconds` by number of attempt where they are known."""
    blank: dict[str, Any] = {"stage": "", "reason": "", "detail": "", "conditions": []}
    place = vars(slot.cell) | {"slot": slot.index}
    rows = (place | blank | dict(row) for row in attempts)
    return tuple(
        row | {TIMED: seconds[row["attempt"]]} if row["attempt"] in seconds else row for row in rows
    )


def slot_part(slot: Slot) -> str:
    """The part of the physics key that names the slot."""
    return digest([f"{slot.cell.path}/{episode_name(slot.index)}", slot.cell.alpha])


def pack_keys(slot: Slot, keys: SlotKeys) -> str:
    """Canonical JSON of keys, null for parts that follow from the slot."""
    values: dict[str, dict[str, str | None]] = {
        kind: {**parts} for kind, parts in keys.to_json().items()
    }
    for kind, name, follows in (
        ("physics", "slot", slot_part(slot)),
        ("render", "physics", keys.physics.digest),
        ("language", "physics", keys.physics.digest),
    ):
        if values[kind].get(name) == follows:
            values[kind][name] = None
    return canonical(values).decode()


def unpack_keys(slot: Slot, text: str) -> SlotKeys:
    """Inverse of `pack_keys`."""
    values = {kind: dict(parts) for kind, parts in json.loads(text).items()}
    if "slot" in values["physics"]:
        values["physics"]["slot"] = values["physics"]["slot"] or slot_part(slot)
    physics = Key(values["physics"])
    for kind in ("render", "language"):
        if "physics" in values[kind]:
            values[kind]["physics"] = values[kind]["physics"] or physics.digest
    return SlotKeys(physics, Key(values["render"]), Key(values["language"]))
