"""Checks that the stored robot, cameras and sentences of an episode follow from its joints, its spec and its bodies."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.cameras import world_poses
from pipeline.motion.recorded.group import TRACKS
from pipeline.poses import compose
from pipeline.run.slot.make import sentences
from pipeline.run.slot.redraw import cached_parts
from pipeline.run.verify.physics import Physics
from pipeline.run.verify.tally import Finding, observe
from pipeline.stages.render import body_poses, stored_appearance
from pipeline.stages.tracks import track_arrays
from pipeline.world.robots.contract import jaw_value
from pipeline.world.robots.forward import link_poses

CLOSE = 1e-3
"""Metres, and parts of a rotation, by which the poses of the simulator may differ from those computed."""


def check_robot(p: Physics) -> Iterator[Finding]:
    """Joints place the links, the hands the end effectors, the measured vector is that of the joints, cameras are where they are
    mounted."""
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


CHECKS = {"robot": check_robot, "tracks": check_tracks, "instructions": check_sentences}
"""Name of the promise that is broken where one of these cannot be judged at all -> how it is judged."""
