"""Small synthetic episode files for tests: no simulator, known numbers and colours.

The target slides along world x at SPEED; in the head camera a square sits on its true projection,
in the wrist cameras a square drifts by DRIFT pixels a frame. Segmentation and depth agree with the
square where they are asked for.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CAMERA_TYPES, Camera, View, project
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.file import Episode
from pipeline.data.episode.meta import CameraInfo, EpisodeMeta
from pipeline.data.episode.state_log import CONTACT_DTYPE, Event, SkillRun, StateLog, Touch
from pipeline.data.episode.writer import write_episode
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import Pose, compose, frame, pose
from pipeline.world.looks.visuals import CLEAN

CAMERAS = ("head_camera", "left_camera", "right_camera")
COLORS = {"head_camera": (220, 30, 30), "left_camera": (30, 200, 40), "right_camera": (30, 50, 220)}
BACKGROUND = (120, 125, 130)
HALF = 20  # half side of the square, pixels
DRIFT = (3, 2)  # pixels a frame of the wrist images
SPEED = 0.08  # m/s of the target along world x
# rad/s of the target about world z, by its angular velocity only: its pose does not turn
SPIN = 0.5
TABLE_TOP = 0.74
ARM_JOINTS = {"franka-panda": 7}  # every other embodiment has 6 joints an arm


def head_pose() -> Pose:
    """World pose of the synthetic head camera: behind the table, looking at its middle."""
    return frame((0.0, -0.5, 1.4), (0.0, 0.5, -0.66), (-1.0, 0.0, 0.0))


def vector_names(embodiment: str) -> tuple[str, ...]:
    """Names of the state and action vector, 14 of them or 16."""
    joints = [f"joint{i + 1}" for i in range(ARM_JOINTS.get(embodiment, 6))]
    return tuple(f"{side}_{n}" for side in ("left", "right") for n in (*joints, "gripper"))


def target_pose(times: NDArray[np.float64], seed: int = 0) -> NDArray[np.float64]:
    """Poses (T,7) of the target: along world x at SPEED, upright, on the table."""
    poses = np.repeat(pose((-0.08, 0.02 + 0.005 * (seed % 5), TABLE_TOP))[None], len(times), 0)
    poses[:, 0] += SPEED * times
    return poses


def square_corner(camera: Camera, frame_index: int, target: NDArray[np.float64]) -> tuple[int, int]:
    """Upper left pixel (column, row) of the square, which is 2 HALF wide and high; `target` (T,7)
    are the target's poses."""
    if camera.name == "head_camera":
        uv, _ = project(camera.type, head_pose(), target[frame_index, :3])
        return round(float(uv[0])) - HALF, round(float(uv[1])) - HALF
    return camera.type.width // 4 + DRIFT[0] * frame_index, camera.type.height // 4 + DRIFT[
        1
    ] * frame_index


def make_log(embodiment: str, frames: int, fps: int, seed: int) -> StateLog:
    """A state log with smooth joint motion whose velocities are the true derivatives of its
    positions."""
    times = np.arange(frames) / fps
    names = vector_names(embodiment)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(names))
    grip = np.array([n.endswith("gripper") for n in names])
    # arm joints: 0.5 sin(t + phase) rad; grippers: open to closed over the episode
    closing = 1 - times / max(times[-1], 1 / fps)
    state = np.where(grip, closing[:, None], 0.5 * np.sin(times[:, None] + phase))
    action = np.vstack([state[1:], state[-1:]])
    joints: list[str] = []
    qpos: list[NDArray[np.float64]] = []
    qvel: list[NDArray[np.float64]] = []
    for i, name in enumerate(names):
        if grip[i]:
            side = name.split("_")[0]
            joints += [f"{side}_jaw_a", f"{side}_jaw_b"]
            qpos += [0.04 * state[:, i]] * 2
            qvel += [np.gradient(0.04 * state[:, i], times) if frames > 1 else np.zeros(1)] * 2
        else:
            joints.append(name)
            qpos.append(state[:, i])
            qvel.append(0.5 * np.cos(times + phase[i]))
    target = target_pose(times, seed)
    still = np.repeat(pose((0.1, 0.1, TABLE_TOP))[None], frames, 0)
    hands = [np.repeat(pose((x, -0.2, 0.95))[None], frames, 0) for x in (-0.25, 0.25)]
    for hand in hands:
        hand[:, 2] -= 0.1 * times
    table = np.repeat(pose((0, 0, TABLE_TOP))[None], frames, 0)
    bodies = {
        "target": target,
        "other": still,
        "left_hand": hands[0],
        "right_hand": hands[1],
        "table": table,
    }
    contacts = np.zeros(1, CONTACT_DTYPE)
    contacts[0] = (frames // 2, 0, 2, 0.3, tuple(target[frames // 2, :3]), 4)
    tcp_and_target = (tuple(hands[0][frames // 2].tolist()), tuple(target[frames // 2].tolist()))
    return StateLog(
        times=times,
        bodies=tuple(bodies),
        poses=np.stack(list(bodies.values()), axis=1),
        joints=tuple(joints),
        qpos=np.stack(qpos, axis=1),
        qvel=np.stack(qvel, axis=1),
        vector_names=names,
        state=state,
        action=action,
        tcp=np.stack(hands, axis=1),
        target_velocity=np.repeat([[SPEED, 0.0, 0.0]], frames, 0),
        target_angular_velocity=np.repeat([[0.0, 0.0, SPIN]], frames, 0),
        contacts=contacts,
        # the release falls between two frames on purpose
        events=[
            Event("meeting", float(times[frames // 2])),
            Event("release", float(times[frames // 2]) + 0.4 / fps),
            Event("success", float(times[-1])),
        ],
        skills=make_skills(frames, PHYSICS_HZ // fps),
        touches=[
            Touch(
                "left",
                frames // 2 * (PHYSICS_HZ // fps),
                tuple(target[frames // 2, :3]),
                4,
                *tcp_and_target,
            )
        ],
    )


def make_skills(frames: int, every: int) -> list[SkillRun]:
    """A grasp that meets the target in the middle of an episode, beside the other arm, and a lift;
    `every` steps a frame."""
    middle, last = frames // 2 * every, (frames - 1) * every
    return [
        SkillRun("grasp", ("left",), "target", "high", "meet", 0, middle),
        SkillRun("home", ("right",), "", "", "meet", 0, middle),
        SkillRun("lift", ("left",), "target", "", "finish", middle + every // 2, last),
    ]


def make_motion(log: StateLog, level: int, alpha: float) -> PlanarMotion:
    """The straight motion of the target of a log made by `make_log`, up to the meeting in the
    middle of the log."""
    duration = max(float(log.times[len(log) // 2]), 0.01)
    start = log.pose("target")[0]
    piece = Segment(0.0, duration, np.array([[start[0], SPEED * duration], [start[1], 0.0]]))
    return PlanarMotion(level, alpha, duration, 0.0, float(start[2]), start[3:], (piece,))


def make_view(name: str, log: StateLog, camera_type: str, depth: bool, segmentation: bool) -> View:
    """The images of one camera for a log made by `make_log`."""
    kind = CAMERA_TYPES[camera_type]
    fixed = head_pose()
    link = f"{name.split('_')[0]}_hand" if name in ("left_camera", "right_camera") else None
    camera = Camera(name, kind, link, fixed if link is None else pose((0.05, 0, 0.05)))
    poses = (
        np.repeat(fixed[None], len(log), 0)
        if link is None
        else compose(log.pose(link), camera.pose)
    )
    rgb = np.empty((len(log), kind.height, kind.width, 3), np.uint8)
    rgb[:] = BACKGROUND
    seg = np.zeros(rgb.shape[:3], np.uint8)
    mm = np.full(rgb.shape[:3], 900, np.uint16)
    for t in range(len(log)):
        column, row = square_corner(camera, t, log.pose("target"))
        window = (
            t,
            slice(max(row, 0), max(row + 2 * HALF, 0)),
            slice(max(column, 0), max(column + 2 * HALF, 0)),
        )
        rgb[window] = COLORS[name]
        seg[window] = log.bodies.index("target") + 1
        mm[window] = 850
    return View(camera, poses, rgb, mm if depth else None, seg if segmentation else None)


def make_meta(log: StateLog, fps: int, views: Sequence[View], **other: Any) -> EpisodeMeta:
    """What an episode with a log of `make_log` says about itself; `other` replaces or adds keys."""
    cameras = {view.camera.name: CameraInfo.of(view.camera) for view in views}
    values = {
        "fps": fps,
        "target": "target",
        "manipulated": "target",
        "category": "tracking",
        "arms": {"arm": "left"},
        "meeting_time": float(log.times[len(log) // 2]),
        "average_speed": SPEED,
        "maximum_speed": SPEED,
        "objects": {
            "target": {
                "family": "bell",
                "noun": "bell",
                "description": "red bell",
                "parameters": {"radius": 0.03},
            },
            "other": {
                "family": "block",
                "noun": "block",
                "description": "grey block",
                "parameters": {"half": 0.02},
            },
        },
        "drawing": {"preset": "raster", "visuals": CLEAN, "cameras": cameras},
        "physics_key": "test",
    }
    return EpisodeMeta.model_validate(values | other)


def make_episode(
    path: Path,
    *,
    task: str = "click_bell",
    embodiment: str = "aloha-agilex",
    level: int = 1,
    alpha: float = 0.1,
    domain: str = "clean",
    slot: int = 0,
    seed: int = 0,
    frames: int = 12,
    fps: int = 15,
    cameras: tuple[str, ...] = CAMERAS,
    camera_type: str = "D435",
    depth: bool = False,
    segmentation: bool = False,
    instructions: Mapping[str, list[str]] | None = None,
    meta: Mapping[str, Any] | None = None,
    corrected: int | None = None,
    attempts: Sequence[Mapping[str, Any]] = (),
    spin: bool = True,
) -> Path:
    """Write a synthetic episode file and return its path; 14-wide vectors, 16-wide for
    "franka-panda". In the first `corrected` frames a policy acts. Files of earlier versions have no
    angular velocity (`spin`)."""
    log = make_log(embodiment, frames, fps, seed)
    if not spin:
        log.target_angular_velocity = None
    if corrected is not None:
        acts = np.arange(frames) >= corrected
        log.intervention, log.expert_action = acts, log.action + 0.5 * ~acts[:, None]
    words = task.replace("_", " ")
    views = [make_view(name, log, camera_type, depth, segmentation) for name in cameras]
    episode = Episode(
        spec=EpisodeSpec(task, embodiment, level, alpha, domain, slot, seed),
        log=log,
        motion=make_motion(log, level, alpha).to_json(),
        instructions=instructions
        or {
            "seen": [f"{words} with the left arm", f"please {words}", f"{words} now"],
            "unseen": [f"go and {words}"],
        },
        meta=make_meta(log, fps, views, **(meta or {})),
        attempts=attempts,
    )
    write_episode(path, episode, views)
    return path


def episode_path(
    dataset: Path,
    embodiment: str = "aloha-agilex",
    slot: int = 0,
    task: str = "click_bell",
    level: int = 1,
) -> Path:
    """Where a dataset keeps that episode, clean domain."""
    return (
        dataset
        / "episodes"
        / task
        / embodiment
        / f"L{level}"
        / "clean"
        / f"episode_{slot:07d}.hdf5"
    )
