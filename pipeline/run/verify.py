"""`domino-data verify`: re-check what a dataset promises, from the files alone."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.dataset import Dataset
from pipeline.data.episode import Episode, EpisodeError, EpisodeFile
from pipeline.data.jpeg import decode_frame
from pipeline.data.keys import file_hash
from pipeline.data.physics_id import physics_id
from pipeline.data.recipe import Slot
from pipeline.data.rules import rules_of
from pipeline.motion.target_motion import TargetMotion
from pipeline.registry import UnknownName
from pipeline.run.state import DONE, OPEN, states
from pipeline.stages.scene import build_scene
from pipeline.world.robots.mesh_store import folder_of, mesh_hash

TARGET_TOLERANCE = 1e-3
MEETING_TOLERANCE = 1e-4
CONTACT_SECONDS, CONTACT_METRES = 0.1, 0.01


@dataclass
class Check:
    """One promise: how many episodes were looked at and what was wrong."""

    name: str
    looked: int = 0
    problems: list[str] = field(default_factory=list)
    note: str = ""

    def see(self, ok: bool, problem: str) -> None:
        """Count one observation."""
        self.looked += 1
        if not ok:
            self.problems.append(problem)

    def as_dict(self) -> dict[str, Any]:
        """For printing; at most five problems are spelled out."""
        detail = f"{self.looked} checked" + (f", {self.note}" if self.note else "")
        if self.problems:
            detail += f"; {len(self.problems)} problems: " + "; ".join(self.problems[:5])
        return {"name": self.name, "ok": not self.problems, "checked": self.looked, "detail": detail, "problems": self.problems}


class Verification:
    """All checks of one run, by name, in the order they were first used."""

    def __init__(self) -> None:
        self.checks: dict[str, Check] = {}
        self.meetings: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._sound: set[str] = set()

    def __getitem__(self, name: str) -> Check:
        return self.checks.setdefault(name, Check(name))

    def check_assets(self, name: str, assets: Mapping[str, str], store: AssetStore) -> None:
        """Whether the store holds, whole, what an episode says its images were drawn from; each asset is read once."""
        for body, key in assets.items():
            if key not in self._sound:
                try:
                    store.get(key)
                    self._sound.add(key)
                except AssetError as error:
                    self["assets"].see(False, f"{name}: {body}: {error}")
        self["assets"].see(bool(assets), f"{name}: names no assets, so it cannot be drawn again")


def verify(dataset: Dataset) -> dict[str, Any]:
    """Check every episode and export of a dataset. Returns {"ok", "checks": [...], "meeting": {task: medians}}."""
    recipe, v = dataset.recipe(), Verification()
    accepted: dict[Slot, Path] = {}
    for model, key in recipe.robot_meshes.items():
        same = mesh_hash(dataset.assets, model) == key
        v["robot meshes"].see(same, f"{folder_of(dataset.assets, model)}: not the meshes that the recipe names")
    stale = 0
    for slot, state in states(dataset, recipe):
        record, path = state.record, dataset.episode(slot)
        if record is None or not record.accepted:
            v["files"].see(not path.exists(), f"{path}: has no ledger entry")
            continue
        v["files"].see(path.exists(), f"{path}: is in the ledger and missing; run the build again")
        if not path.exists():
            continue
        stale += state.todo not in (DONE, OPEN)
        v["hashes"].see(file_hash(path) == record.sha256, f"{path}: bytes differ from the ledger's sha256")
        try:
            with EpisodeFile(path) as file:
                name = str(path.relative_to(dataset.root))
                v["variant"].see(file.meta.variant == slot.variant, f"{name}: says that it is variant {file.meta.variant}")
                v.check_assets(name, file.meta.drawing.assets, AssetStore(dataset.bodies))
                check_episode(v, name, file)
            accepted[slot] = path
        except (EpisodeError, KeyError, OSError, ValueError) as error:
            v["readable"].see(False, f"{path}: {error}")
    if stale:
        v["files"].note = f"{stale} made by another version of code or recipe, see status"
    if dataset.attempts.exists():
        rows = pq.read_table(dataset.attempts).to_pylist()
        count, solved = sum(row["outcome"] == "accepted" for row in rows), len({slot.physical for slot in accepted})
        v["attempts"].see(count == solved, f"attempts.parquet has {count} accepted rows for {solved} episodes")
    _summarise_meetings(v)
    _check_exports(v, dataset, list(accepted.values()))
    checks = [check.as_dict() for check in v.checks.values()]
    return {"ok": all(c["ok"] for c in checks), "episodes": len(accepted), "checks": checks, "meeting": _medians(v)}


def check_episode(v: Verification, name: str, file: EpisodeFile) -> None:
    """All checks of one open episode file."""
    episode = file.read()
    log, motion = episode.log, TargetMotion.from_json(episode.motion)
    images = [f"observation/{camera}/rgb" for camera in file.cameras] + ["pointcloud"] * file.has("pointcloud")
    v["frames"].see(
        all(len(file.array(key)) == len(log) for key in images),
        f"{name}: images and timestamps differ in number",
    )
    v["timestamps"].see(
        bool(np.allclose(log.times, np.arange(len(log)) / file.fps, atol=1e-9)), f"{name}: timestamps are not k / fps"
    )
    v["jpeg"].see(_pictures_decode(file), f"{name}: a frame does not decode, or is one flat colour")
    release = log.time_of("release")
    kinematic = log.times < (np.inf if release is None else release)
    gap = np.linalg.norm(log.pose(episode.meta.target)[kinematic, :3] - motion.position(log.times[kinematic]), axis=1).max()
    v["target path"].see(gap < TARGET_TOLERANCE, f"{name}: target {1000 * gap:.2f} mm off its motion")
    v["physics id"].see(
        episode.meta.physics_id == physics_id(episode.spec, log), f"{name}: its physics_id is not that of its spec and state log"
    )
    try:
        scene = build_scene(episode.spec, rules_of(episode.meta))
    except UnknownName as unknown:
        v["success"].see(False, f"{name}: cannot be re-evaluated with this version: {unknown}")
        return
    end = scene.bodies[episode.meta.target].pose[:3]
    miss = float(np.linalg.norm(motion.position(episode.meta.meeting_time) - end))
    v["meeting place"].see(miss < MEETING_TOLERANCE, f"{name}: motion is {1000 * miss:.3f} mm from its end at T_meet")
    _check_speed(v, name, episode, motion)
    _note_meeting(v, episode, motion, end)
    v["success"].see(scene.succeeded(log), f"{name}: success does not hold when re-evaluated from its state log")


def _pictures_decode(file: EpisodeFile) -> bool:
    def good(camera: str) -> bool:
        return all(decode_frame(bytes(data)).std() > 1.0 for data in file.array(f"observation/{camera}/rgb"))

    try:
        return all(good(camera) for camera in file.cameras)
    except EpisodeError:
        return False


def _check_speed(v: Verification, name: str, episode: Episode, motion: TargetMotion) -> None:
    spec = episode.spec
    if not spec.moving:
        v["speed"].see(motion.maximum_speed() == 0.0, f"{name}: the target of a static episode moves")
        return
    speed = motion.maximum_speed() if spec.level == 1 else motion.average_speed()
    v["speed"].see(0 < speed <= spec.alpha * (1 + 1e-6), f"{name}: {speed:.4f} m/s is over alpha {spec.alpha:g}")
    if spec.level == 3:
        jumps = np.atleast_1d(motion.velocity_jumps())
        v["abrupt"].see(bool(len(jumps)) and float(jumps.max()) > 0, f"{name}: a level-3 target never changes velocity abruptly")


def _note_meeting(v: Verification, episode: Episode, motion: TargetMotion, end: np.ndarray) -> None:
    real = episode.log.time_of("meeting")
    if real is None:
        v["meeting"].see(False, f"{episode.spec.task}: no meeting event")
        return
    late = real - episode.meta.meeting_time
    v.meetings[episode.spec.task].append((late, float(np.linalg.norm(motion.position(real) - end))))


def _medians(v: Verification) -> dict[str, dict[str, float]]:
    return {
        task: {
            "median_abs_seconds": float(np.median([abs(t) for t, _ in pairs])),
            "median_metres": float(np.median([d for _, d in pairs])),
            "worst_seconds": float(max((t for t, _ in pairs), key=abs)),
        }
        for task, pairs in v.meetings.items()
    }


def _summarise_meetings(v: Verification) -> None:
    for task, m in _medians(v).items():
        check = v["meeting"]
        close = m["median_abs_seconds"] <= CONTACT_SECONDS and m["median_metres"] <= CONTACT_METRES
        said = f"{task} {1000 * m['median_abs_seconds']:.0f} ms {1000 * m['median_metres']:.1f} mm"
        check.see(close, f"{task}: first contact is off by a median of {said}")
        check.note = f"{check.note}, {said}" if check.note else f"medians: {said}"


def _check_exports(v: Verification, dataset: Dataset, episodes: list[Path]) -> None:
    if not (dataset.root / "exports").is_dir():
        return
    from pipeline.export import EXPORTERS

    for name, exporter in EXPORTERS.items():
        place = dataset.exports(name)
        if place.exists():
            problems = exporter.check(dataset.root, place, sorted(episodes))
            v[f"export {name}"].see(not problems, "; ".join(problems[:3]))
