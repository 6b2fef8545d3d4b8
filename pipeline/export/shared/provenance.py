"""Where an episode comes from, as columns."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.data.episode.state_log import StateLog
from pipeline.data.names import SIDES
from pipeline.data.setup.rules import rules_of
from pipeline.data.slots.select import VALIDATION, split_of
from pipeline.export.shared.derived import interception
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import Facts, same
from pipeline.export.shared.script import rows_of
from pipeline.export.shared.tables import RowWriter
from pipeline.motion.recorded import conditions_of


def scalars(facts: Facts, validation: float = VALIDATION) -> dict[str, Any]:
    """Provenance of an episode, one value a column. Rows of one `physics_id` share their `split`.
    `rules` is a label (data/setup/rules.py). T_meet and x_meet ... (m) are the planned meeting;
    other t_ are s since the first frame, None for what did not happen. Speeds are m/s along the
    planned motion. `skills` (script.rows_of) and `conditions` (time from which each holds to the
    end) are JSON."""
    spec, log, meta, derived = facts.spec, facts.log, facts.meta, interception(facts)
    arms, first = meta.arms, derived.first_contacts
    return {
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
        "t_motion_start": float(derived.motion_start - log.times[0]),
        **{f"t_{event}": _time(log, event) for event in ("meeting", "release", "success")},
        **{
            f"t_contact_{side}": float(first[side].time - log.times[0]) if side in first else None
            for side in SIDES
        },
        "average_speed": meta.average_speed,
        "maximum_speed": meta.maximum_speed,
        "physics_id": meta.physics_id,
        "variant": meta.variant,
        "split": split_of(spec.pair or meta.physics_id or spec.to_json(), validation),
        "target": meta.target,
        "arms": "+".join(sorted(set(arms.values()))),
        "physics_key": meta.physics_key,
        "source": facts.source,
        **({"dataset": facts.dataset} if facts.dataset else {}),
        **({"pair": spec.pair, "arm": spec.arm} if facts.paired else {}),
        "skills": json.dumps(rows_of(facts)),
        "conditions": json.dumps(_since(facts)),
        "failure": meta.failure.model_dump_json() if meta.failure else "",
    }


def _since(facts: Facts) -> dict[str, float | None]:
    """Time (s) from which each condition holds to the end, or None."""
    since = dict[str, float | None]()
    for name, holds in conditions_of(facts.interception).items():
        failing = np.flatnonzero(~holds)
        first = int(failing[-1]) + 1 if len(failing) else 0
        since[name] = (
            float(facts.log.times[first] - facts.log.times[0]) if first < len(holds) else None
        )
    return since


def _time(log: StateLog, event: str) -> float | None:
    time = log.time_of(event)
    return None if time is None else float(time - log.times[0])


_SPEEDS = ("average_speed", "maximum_speed")
SCALAR_TYPES = {
    **dict.fromkeys(
        ("task", "category", "embodiment", "domain", "rules", "target", "arms", "physics_key"),
        pa.string(),
    ),
    **dict.fromkeys(("source", "dataset", "skills", "conditions", "failure"), pa.string()),
    **dict.fromkeys(("physics_id", "split", "pair", "arm"), pa.string()),
    **dict.fromkeys(("level", "slot", "seed", "variant"), pa.int64()),
    **dict.fromkeys(
        ("alpha", "T_meet", "t_meeting", "t_release", "t_success", *_SPEEDS), pa.float64()
    ),
    **dict.fromkeys(
        ("x_meet", "y_meet", "z_meet", "t_motion_start", "t_contact_left", "t_contact_right"),
        pa.float64(),
    ),
}

TEXTS = pa.list_(pa.string())


def provenance_schema(mixed: bool) -> pa.Schema:
    """The columns of `provenance`: with `dataset` where an export is of several."""
    without = ("pair", "arm") if mixed else ("pair", "arm", "dataset")
    scalar = {k: v for k, v in SCALAR_TYPES.items() if k not in without}
    texts = {"instructions_seen": TEXTS, "instructions_unseen": TEXTS}
    return pa.schema(
        {
            **{"episode_index": pa.int64(), "length": pa.int64(), **scalar},
            **{"instruction": pa.string(), **texts},
            **dict.fromkeys(("motion", "objects", "events"), pa.string()),
        }
    )


def provenance(index: int, facts: Facts, validation: float) -> dict[str, Any]:
    """One row of `provenance_schema`; motion, objects and events as JSON."""
    return {
        "episode_index": index,
        "length": facts.kept,
        **scalars(facts, validation),
        "instruction": facts.instruction,
        "instructions_seen": facts.seen,
        "instructions_unseen": facts.unseen,
        "motion": facts.motion,
        "objects": json.dumps(
            {name: info.model_dump() for name, info in facts.meta.objects.items()}, sort_keys=True
        ),
        "events": json.dumps([[e.name, e.time] for e in facts.log.events]),
    }


PROVENANCE = "episodes.parquet"
"""File of these rows in most formats."""


class Provenance(RowWriter):
    """A Parquet file of `provenance` rows."""

    def __init__(self, path: Path, draft: ExportDraft) -> None:
        super().__init__(path, provenance_schema(draft.mixed), 100)
        self.validation = draft.validation
        self.count = self.frames = 0
        self._firsts = dict[str, Facts]()

    def append(self, facts: Facts) -> None:
        """Add an episode. Raises ExportError if it does not fit the first of its robot."""
        same(self._firsts.setdefault(facts.spec.embodiment, facts), facts)
        self.add(provenance(self.count, facts, self.validation))
        self.count += 1
        self.frames += len(facts)
