"""Whether an episode is what it says: clock, path and speed of the target, meeting, success, robot, tracks and sentences."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.cameras import world_poses
from pipeline.data.episode.file import Episode
from pipeline.data.episode.physics_id import physics_id
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.rules import rules_of
from pipeline.motion.contract import TargetMotion
from pipeline.motion.models import MODELS, motion_from_json
from pipeline.motion.recorded.group import TRACKS, conditions_of, physics_arrays
from pipeline.motion.recorded.interception import Interception
from pipeline.poses import compose
from pipeline.registry import UnknownName
from pipeline.run.identity.slot_keys import slot_keys
from pipeline.run.slot.make import sentences
from pipeline.run.slot.redraw import cached_parts
from pipeline.run.verify.tally import Finding, observe
from pipeline.stages.drawing.render import body_poses, stored_appearance
from pipeline.stages.drawing.tracks import track_arrays
from pipeline.stages.scene import Scene, build_scene
from pipeline.world.robots.contract import jaw_value
from pipeline.world.robots.forward import link_poses

TARGET_TOLERANCE = 1e-3
MEETING_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Physics:
    """One episode, its motion, and its scene built again. `keys` are those of its ledger entry, `camera_poses` (T, 7) by camera;
    `bodies` is where the dataset keeps what they look like."""

    episode: Episode
    recipe: Recipe
    slot: Slot
    keys: SlotKeys
    camera_poses: Mapping[str, NDArray[np.float64]]
    bodies: Path

    @cached_property
    def now(self) -> SlotKeys | None:
        """The keys that the slot would have now; None for a task or robot that this version does not have."""
        try:
            return slot_keys(self.recipe, self.slot)
        except UnknownName:
            return None

    @cached_property
    def motion(self) -> TargetMotion:
        """The target's motion as stored. Raises ValueError, KeyError or TypeError for text that is none."""
        return motion_from_json(self.episode.motion)

    @cached_property
    def built(self) -> Scene | UnknownName:
        """The scene of the spec by the rules that the header names, or the error for a name that this version does not have.

        Raises ValueError for a header that names rules which do not exist.
        """
        try:
            return build_scene(self.episode.spec, rules_of(self.episode.meta))
        except UnknownName as unknown:
            return unknown

    @property
    def scene(self) -> Scene | None:
        """As `built`, None for a task or robot that this version does not have."""
        return None if isinstance(self.built, UnknownName) else self.built

    @property
    def end(self) -> np.ndarray:
        """Where robot and target are to meet (3,), m."""
        return np.zeros(3) if self.scene is None else self.scene.bodies[self.episode.meta.target].pose[:3]

    def meeting(self) -> tuple[float, float] | None:
        """The error of the first contact: its delay (s), and the distance of the target's motion from its end then (m).

        None for the reactive expert, which meets the target when it can."""
        real = self.episode.log.time_of("meeting")
        if real is None or self.scene is None or self.episode.meta.expert == "reactive":
            return None
        return real - self.episode.meta.meeting_time, float(np.linalg.norm(self.motion.pose(real)[:3] - self.end))


def check_clock(p: Physics) -> Iterator[Finding]:
    """Frames are k / fps, events fall between them and are those of an accepted episode."""
    log, fps = p.episode.log, p.episode.meta.fps
    yield observe("timestamps", np.allclose(log.times, np.arange(len(log)) / fps, atol=1e-9), "timestamps are not k / fps")
    outside = [e.name for e in log.events if not 0 <= e.time <= log.times[-1] + 1 / fps]
    yield observe("events", not outside, f"{', '.join(outside)} is not within the episode")
    for wanted in ("meeting", "success"):
        yield observe("events", log.event(wanted), f"has no {wanted} event")


def check_identity(p: Physics) -> Iterator[Finding]:
    """Its physics_id is that of spec and log; its instructions are sentences."""
    e = p.episode
    same = e.meta.physics_id == physics_id(e.spec, e.log)
    yield observe("physics id", same, "its physics_id is not that of its spec and state log")
    for split, texts in e.instructions.items():
        right = bool(texts) and all(text.strip() and text.isprintable() for text in texts)
        yield observe("instructions", right, f"instruction/{split} is empty or holds what is no sentence")


def check_motion(p: Physics) -> Iterator[Finding]:
    """The target is on its motion until it is released, and no faster than alpha; level 3 is abrupt."""
    e, motion, log = p.episode, p.motion, p.episode.log
    freed = log.time_of("meeting" if e.meta.contact == "hold" else "release")
    kinematic = log.times < (np.inf if freed is None else freed)
    gap = np.linalg.norm(log.pose(e.meta.target)[kinematic, :3] - motion.pose(log.times[kinematic])[:, :3], axis=1).max()
    yield observe("target path", gap < TARGET_TOLERANCE, f"target {1000 * gap:.2f} mm off its motion")
    if not e.spec.moving:
        yield observe("speed", motion.features().maximum_speed == 0.0, "the target of a static episode moves")
        return
    same = (motion.level, motion.alpha) == (e.spec.level, e.spec.alpha)
    yield observe("motion", same, f"its motion is of level {motion.level} at alpha {motion.alpha:g}, not of its spec")
    for verdict in MODELS[motion.model].judge(motion, p.recipe.speed_bound):
        yield observe(verdict.name, verdict.holds, verdict.problem)
    stated, found = (e.meta.average_speed, e.meta.maximum_speed), motion.features()
    right = np.allclose(stated, (found.average_speed, found.maximum_speed), atol=1e-6)
    yield observe("speed", right, f"states speeds of {stated} m/s")


def check_success(p: Physics) -> Iterator[Finding]:
    """The motion ends at the meeting place, and success holds when evaluated again from the state log."""
    if p.scene is None:
        yield Finding("success", f"cannot be re-evaluated with this version: {p.built}")
        return
    miss = float(np.linalg.norm(p.motion.pose(p.episode.meta.meeting_time)[:3] - p.end))
    yield observe("meeting place", miss < MEETING_TOLERANCE, f"motion is {1000 * miss:.3f} mm from its end at T_meet")
    yield observe("success", p.scene.succeeded(p.episode.log), "success does not hold when re-evaluated from its state log")


def check_interception(p: Physics) -> Iterator[Finding]:
    """The group `interception` is what follows from the state log; runs of skills lie within the episode."""
    e, log = p.episode, p.episode.log
    derived = Interception(e.meta, log, p.motion, log.pose(e.meta.target))
    conditions = conditions_of(e.interception)
    for key, wanted in physics_arrays(derived, conditions).items():
        same = key in e.interception and np.array_equal(e.interception[key], wanted)
        yield observe("interception", same, f"interception/{key} differs from the state log")
    failing = [name for name, holds in conditions.items() if len(holds) != len(log) or not holds[-1]]
    yield observe("interception", not failing, f"condition {', '.join(failing)} does not hold at the end")
    met, sides = log.event("meeting"), {touch.side: touch for touch in log.touches}
    touch = next((sides[side] for side in sides if met and met.by.startswith(f"{side}_") and met.by not in e.meta.objects), None)
    right = touch is None or (met is not None and touch.step == round(met.time * e.meta.physics_hz))
    yield observe("interception", right, "its first contact is not at the meeting")
    last = round(float(log.times[-1]) * e.meta.physics_hz)
    inside = all(0 <= run.start < run.end <= last for run in log.skills) and bool(log.skills)
    yield observe("interception", inside, "its runs of skills are missing or not within the episode")


CLOSE = 1e-3  # metres, and parts of a rotation, by which the poses of the simulator may differ from those computed


def check_robot(p: Physics) -> Iterator[Finding]:
    """Joints place the links, and hands the end effectors; the measured vector and the cameras follow from them."""
    log, meta = p.episode.log, p.episode.meta
    columns = {name: log.qpos[:, number] for number, name in enumerate(log.joints)}
    if p.scene is not None and p.now is not None and p.now.physics == p.keys.physics:
        for number, (side, arm) in enumerate(p.scene.embodiment.arms.items()):
            own = {name.removeprefix(f"{side}_"): values for name, values in columns.items() if name.startswith(f"{side}_")}
            placed = {f"{side}_{link}": pose for link, pose in link_poses(arm, own).items()}
            odd = [body for body in log.bodies if body in placed and not _same(log.pose(body), placed[body])]
            said = f"{', '.join(odd[:3])} {'is' if len(odd) == 1 else 'are'} not where the joints place them"
            yield observe("robot", not odd, said)
            tool = compose(log.pose(f"{side}_{arm.hand}"), arm.tcp)
            yield observe("robot", _same(log.tcp[:, number], tool), f"endpose/{side}_endpose is not that of the hand")
            names = [*(f"{side}_{name}" for name in arm.arm_joints), f"{side}_gripper"]
            jaws = np.stack([own[name] for name in arm.gripper.joints], axis=1)
            measured = [*(own[name] for name in arm.arm_joints), np.array([jaw_value(arm.gripper, row) for row in jaws])]
            state = log.state[:, [log.vector_names.index(name) for name in names]]
            same = np.allclose(state, np.stack(measured, axis=1), atol=CLOSE)
            yield observe("robot", same, f"joint_state of the {side} arm is not that of the joints")
    for name, info in meta.drawing.cameras.items():
        mounted = world_poses(info.camera(name), body_poses(log.late(meta.drawing.latency)), len(log))
        yield observe("cameras", _same(p.camera_poses[name], mounted), f"{name} is not where it is mounted")


def check_tracks(p: Physics) -> Iterator[Finding]:
    """Tracks of the objects are those of the stored bodies and cameras, at three frames, where the code is the same."""
    log = p.episode.log.late(p.episode.meta.drawing.latency)
    stored = {k: v for k, v in p.episode.interception.items() if k.startswith(TRACKS)}
    if not stored or p.now != p.keys or not p.episode.meta.drawing.assets:
        return
    frames = sorted({0, len(log) // 2, len(log) - 1})
    some = replace(log, times=log.times[frames], poses=log.poses[frames])
    objects = [name for name in p.episode.meta.objects if name not in p.episode.meta.clutter]
    try:
        appearance = stored_appearance(p.episode, AssetStore(p.bodies), cached_parts)
    except AssetError:
        return  # another check names the asset
    made = track_arrays(appearance, some, objects)
    odd = sorted(key for key in {*stored, *made} if key not in stored or key not in made or _differ(stored[key][frames], made[key]))
    yield observe("tracks", not odd, f"interception/{''.join(odd[:1])} is not where its bodies are")


def _differ(stored: np.ndarray, made: np.ndarray) -> bool:
    """Whether two tracks differ; they are in pixels, metres or shares, and NaN while the object is not seen."""
    return stored.shape != made.shape or not np.allclose(stored, made, rtol=1e-3, atol=2e-2, equal_nan=True)


def check_sentences(p: Physics) -> Iterator[Finding]:
    """Instructions are those of the scene, where the code that makes sentences is the one that made them."""
    if p.scene is None or p.now is None or p.now.language != p.keys.language:
        return
    wanted = sentences(p.scene, p.recipe.instructions)
    for split, made in wanted.items():
        same = list(p.episode.instructions[split]) == made
        yield observe("instructions", same, f"instruction/{split} is not that of its scene")


def _same(stored: np.ndarray, computed: np.ndarray) -> bool:
    """Whether poses (T, 7) are the same; a quaternion and its negative are one rotation."""
    computed = np.broadcast_to(computed, stored.shape)
    turned = np.sign((stored[:, 3:] * computed[:, 3:]).sum(1, keepdims=True))
    return bool(
        np.allclose(stored[:, :3], computed[:, :3], atol=CLOSE) and np.allclose(stored[:, 3:], turned * computed[:, 3:], atol=CLOSE)
    )


CHECKS = {
    "timestamps": check_clock,
    "physics id": check_identity,
    "target path": check_motion,
    "success": check_success,
    "interception": check_interception,
    "robot": check_robot,
    "tracks": check_tracks,
    "instructions": check_sentences,
}
"""Name of the promise that is broken where one of these cannot be judged at all -> how it is judged."""
