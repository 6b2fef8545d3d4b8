"""puma-gt: the target's true motion as PUMA's loader reads it, <dataset name>/ep000/gt.pkl.

`pose7_frame_aligned` (T,7) is by frame, `pose7_sim` (N,7) by physics step until the meeting;
poses are x y z qw qx qy qz."""

import pickle
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.formats.lerobot.options import datasets_of
from pipeline.export.options import option
from pipeline.export.shared.derived import interception
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.tables import PROVENANCE, Provenance
from pipeline.motion.contract import TargetMotion
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.recorded import Interception

PROTOCOL = 4
KINDS = {0: "velocity", 1: "velocity", 2: "trajectory"}


def _component(text: str) -> str:
    if text in ("", ".", "..") or "/" in text or "\0" in text:
        raise ValueError("give the name of a directory, not a path")
    return text


@dataclass(frozen=True)
class PumaGtOptions:
    per_task: bool = option(
        "episodes numbered as in a LeRobot export with --per-task", default=False
    )
    dataset_name: str = option(
        "name of the LeRobot directory where there is one embodiment only",
        _component,
        "lerobot-v2.1",
    )


def trajectory_params(motion: TargetMotion) -> dict[str, Any]:
    """A velocity (m/s), or polynomials over 0 to 1 (m), highest power first."""
    duration = {"total_duration": motion.duration + motion.lead}
    if not isinstance(motion, PlanarMotion):
        return {"type": motion.model, **duration}
    pieces = [_piece(segment) for segment in motion.segments]
    if motion.level in KINDS and len(pieces) == 1:
        kind = KINDS[motion.level]
        keys = ("velocity",) if kind == "velocity" else ("poly_x_coeffs", "poly_y_coeffs")
        return {"type": kind, **{key: pieces[0][key] for key in keys}, **duration}
    return {"type": "segmented", "segment_trajectories": pieces, **duration}


def _piece(segment: Segment) -> dict[str, Any]:
    span, powers = segment.end - segment.start, segment.coefficients.shape[1]
    slope = segment.coefficients[:, 1] / span if powers > 1 else np.zeros(2)
    x, y = segment.coefficients[:, ::-1].tolist()
    return {
        "type": "velocity" if powers <= 2 else "trajectory",
        "duration": span,
        "velocity": [float(slope[0]), float(slope[1]), 0.0],
        "poly_x_coeffs": x,
        "poly_y_coeffs": y,
    }


def payload(index: int, facts: Facts, derived: Interception) -> dict[str, Any]:
    spec, motion, rate = facts.spec, derived.motion, derived.rate
    begin, end = round(derived.motion_start * rate), round(motion.duration * rate)
    path = motion.pose(np.arange(begin, end + 1) / rate)
    params = trajectory_params(motion)
    info = {
        "start_position": path[0, :3],
        "original_orientation": path[0, 3:],
        "kinematic_duration": float(motion.duration + motion.lead),
        "trajectory_params": params,
    }
    return {
        "task_name": spec.task,
        "task_config": f"{spec.embodiment}_{spec.domain}_level{spec.level}",
        "source": facts.source,
        "episode_idx": index,
        "seed": spec.seed,
        "quat_order": "wxyz",
        "sim_timestep": 1 / rate,
        "frame_count": len(facts),
        "dynamic_motion_info": info,
        "trajectory_params": params,
        "pose7_sim": path,
        "pose7_frame_aligned": facts.target,
        "avg_speed_mps": float(facts.meta.average_speed),
    }


@register
class PumaGt(Exporter[PumaGtOptions]):
    name = "puma-gt"
    options = PumaGtOptions

    def write(self, job: Job[PumaGtOptions], draft: ExportDraft) -> dict[str, Any]:
        frames, out, options = 0, draft.folder, job.options
        for root, paths in datasets_of(job.episodes, out, options.per_task).values():
            root = out / options.dataset_name if root == out else root
            root.mkdir(parents=True)
            with closing(Provenance(root / PROVENANCE, draft)) as rows:
                for index, path in enumerate(paths):
                    with rows.noting(job, path) as (_, facts):
                        told = payload(index, facts, interception(facts))
                    place = root / f"ep{index:03d}"
                    place.mkdir()
                    (place / "gt.pkl").write_bytes(pickle.dumps(told, protocol=PROTOCOL))
            frames += rows.frames
        return {"episodes": len(job.episodes), "frames": frames}
