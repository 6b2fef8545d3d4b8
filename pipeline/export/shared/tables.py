"""Parquet files being written, and the origin of each episode."""

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.actions import JOINTS
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import SIDES
from pipeline.data.setup.rules import rules_of
from pipeline.data.slots.select import VALIDATION, split_of
from pipeline.motion.recorded import conditions_of

from .derived import interception
from .draft import ExportDraft, Job
from .episodes import Facts, read_facts, reading, same
from .script import rows_of


class TableWriter(pq.ParquetWriter):
    """After an error it is given up: pyarrow would try again."""

    def close(self) -> None:
        try:
            super().close()
        finally:
            self.is_open = False

    def write_table(self, *given: Any, **options: Any) -> None:
        try:
            super().write_table(*given, **options)
        except OSError:
            with suppress(OSError):
                self.close()
            raise


def scalars(
    facts: Facts, optional: Collection[str], validation: float = VALIDATION
) -> dict[str, Any]:
    """Where an episode comes from, a value a column. T_meet (s) and x_meet ... (m) are planned;
    other t_ are s since the first frame, None for what did not happen; speeds are m/s."""
    spec, log, meta, derived = facts.spec, facts.log, facts.meta, interception(facts)
    start, first = log.times[0], derived.first_contacts
    times = {f"t_{event}": log.time_of(event) for event in ("meeting", "release", "success")}
    times |= {
        f"t_contact_{side}": first[side].step / derived.rate if side in first else None
        for side in SIDES
    }
    row = {
        "task": spec.task,
        "category": meta.category,
        "embodiment": spec.embodiment,
        "level": spec.level,
        "alpha": float(spec.alpha),
        "domain": spec.domain,
        "rules": rules_of(meta).label,
        "slot": spec.slot,
        "seed": spec.seed,
        "T_meet": meta.meeting_time,
        **dict(zip(("x_meet", "y_meet", "z_meet"), derived.planned_position.tolist(), strict=True)),
        "t_motion_start": float(derived.motion_start - start),
        **{name: None if t is None else float(t - start) for name, t in times.items()},
        "average_speed": meta.average_speed,
        "maximum_speed": meta.maximum_speed,
        "physics_id": meta.physics_id,
        "variant": meta.variant,
        "split": split_of(spec.pair or meta.physics_id or spec.to_json(), validation),
        "target": meta.target,
        "arms": "+".join(sorted(set(meta.arms.values()))),
        "physics_key": meta.physics_key,
        "source": facts.source,
        "dataset": facts.dataset,
        "pair": spec.pair,
        "arm": spec.arm,
        "choices": json.dumps(meta.choices, sort_keys=True),
        "skills": json.dumps(rows_of(facts)),
        "conditions": json.dumps(_since(facts)),
        "failure": meta.failure.model_dump_json() if meta.failure else "",
    }
    return {n: value for n, value in row.items() if n not in OPTIONAL or n in optional}


def _since(facts: Facts) -> dict[str, float | None]:
    since, times = dict[str, float | None](), facts.log.times
    for name, holds in conditions_of(facts.interception).items():
        failing = np.flatnonzero(~holds)
        first = int(failing[-1]) + 1 if len(failing) else 0
        since[name] = float(times[first] - times[0]) if first < len(holds) else None
    return since


OPTIONAL = ("dataset", "pair", "arm", "choices")

_TEXTS = (
    *("task", "category", "embodiment", "domain", "rules", "target", "arms", "physics_key"),
    *("source", "dataset", "skills", "conditions", "failure", "physics_id", "split"),
    *OPTIONAL[1:],
)
_NUMBERS = (
    *("alpha", "T_meet", "t_meeting", "t_release", "t_success", "average_speed", "maximum_speed"),
    *("x_meet", "y_meet", "z_meet", "t_motion_start", "t_contact_left", "t_contact_right"),
)
SCALAR_TYPES = {
    **dict.fromkeys(_TEXTS, pa.string()),
    **dict.fromkeys(("level", "slot", "seed", "variant"), pa.int64()),
    **dict.fromkeys(_NUMBERS, pa.float64()),
}

PROVENANCE, GROUP = "episodes.parquet", 100


class Provenance:
    def __init__(self, path: Path, draft: ExportDraft) -> None:
        self.optional = draft.optional
        without = {*OPTIONAL} - self.optional
        texts = pa.list_(pa.string())
        schema = {
            **{"episode_index": pa.int64(), "length": pa.int64()},
            **{name: kind for name, kind in SCALAR_TYPES.items() if name not in without},
            **{"instruction": pa.string(), "instructions_seen": texts},
            **{"instructions_unseen": texts},
            **dict.fromkeys(("motion", "objects", "events"), pa.string()),
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = TableWriter(path, pa.schema(schema), compression="zstd")
        self.validation = draft.validation
        self.count = self.frames = 0
        self._firsts, self._rows = dict[str, Facts](), list[dict[str, Any]]()

    @contextmanager
    def noting(self, job: Job[Any], path: Path) -> Iterator[tuple[EpisodeFile, Facts]]:
        """An episode, open, and its facts, which are appended. Raises as `reading`."""
        representation = getattr(job.options, "representation", JOINTS)
        with reading(path) as file:
            facts = read_facts(file, job.dataset, representation=representation)
            self.append(facts)
            yield file, facts
        job.advance()

    def append(self, facts: Facts) -> None:
        same(self._firsts.setdefault(facts.spec.embodiment, facts), facts)
        objects = {name: info.model_dump() for name, info in facts.meta.objects.items()}
        self._rows.append(
            {
                "episode_index": self.count,
                "length": facts.kept,
                **scalars(facts, self.optional, self.validation),
                "instruction": facts.instruction,
                "instructions_seen": facts.seen,
                "instructions_unseen": facts.unseen,
                "motion": facts.motion,
                "objects": json.dumps(objects, sort_keys=True),
                "events": json.dumps([[e.name, e.time] for e in facts.log.events]),
            }
        )
        self.count += 1
        self.frames += len(facts)
        if len(self._rows) == GROUP:
            self._flush()

    def _flush(self) -> None:
        if self._rows:
            self._writer.write_table(pa.Table.from_pylist(self._rows, schema=self._writer.schema))
            self._rows.clear()

    def close(self) -> None:
        if self._writer.is_open:
            self._flush()
            self._writer.close()
