"""Stage 2: the motion that brings the target to the meeting on time."""

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import numpy as np

from pipeline.data.setup import Setup
from pipeline.expert.actor import SWEEP_HZ
from pipeline.motion.contract import Free, MotionRequest, NoMotion, Streams, TargetMotion
from pipeline.motion.models import back_calculate_motion
from pipeline.motion.wrapped import CARRIED, Company, Rider
from pipeline.planning.collision_pieces import Sweep
from pipeline.poses import Bools, Floats, Pose, compose, inverse, quat_rotate
from pipeline.tasks import middle
from pipeline.world.physics.body import TABLE_TOP, colliders_of
from pipeline.world.shapes import Collider

from .dry_run import DryRun
from .failure import Failure
from .scene import Scene

EARLY = 0.08  # s by which the first touch may come before the planned meeting
MARGIN = 0.002  # m from the moving target that counts as a touch
CLOSING, NEAR = 0.4, 0.00025
"""Time (s) before the meeting from which what does not grasp the target may come nearer, and what
(m) counts as a touch then: fingertips creep down on it."""

NEVER = frozenset({"table"})  # bodies that the target may always touch


def beside(
    scene: Scene, dry: DryRun, name: str, moving: Mapping[str, TargetMotion]
) -> Callable[[TargetMotion], bool]:
    """The test for a body beside the target: it keeps MARGIN from the dry run and from what is
    `moving`.
    """
    poses = dry.sweep[: int(dry.meeting * SWEEP_HZ) + 1].copy()
    times = np.arange(len(poses)) / SWEEP_HZ
    for other, motion in moving.items():
        poses[:, dry.names.index(other)] = motion.pose(times)
    waiting = {scene.task.target, *scene.task.movers} - moving.keys()
    pieces = _others(scene, dry, {name, *waiting})
    sweep = Sweep(pieces, poses, scene.bodies[name].instance.shape().collision, MARGIN)
    return lambda motion: sweep.first_contact(motion.pose(times)) is None


class Clearance:
    """The sweep of a dry run as moving collision pieces."""

    def __init__(self, scene: Scene, dry: DryRun) -> None:
        count = int((dry.meeting - EARLY) * SWEEP_HZ) + 1
        late = max(0, int((dry.meeting - CLOSING) * SWEEP_HZ)) if dry.approach is None else count
        target = scene.bodies[scene.task.target].instance.shape().collision
        self._others = _others(scene, dry, {scene.task.target, *scene.task.movers})
        self._poses, self._times = dry.sweep[:count], np.arange(count) / SWEEP_HZ
        parts = [(np.arange(late), MARGIN), (np.arange(late, count), NEAR)]
        self._parts = [
            (k / SWEEP_HZ, Sweep(self._others, dry.sweep[k], target, margin))
            for k, margin in parts
            if len(k)
        ]

    def free(self, motion: TargetMotion) -> bool:
        """Whether all keeps MARGIN from the moving target until EARLY before the meeting; NEAR at
        the end.
        """
        if any(sweep.first_contact(motion.pose(t)) is not None for t, sweep in self._parts):
            return False
        for prop in motion.scenery():
            if prop.solid:
                sweep = Sweep(self._others, self._poses, colliders_of(prop), MARGIN)
                if sweep.first_contact(prop.pose(self._times)) is not None:
                    return False
        return True


def _others(scene: Scene, dry: DryRun, without: Collection[str]) -> list[tuple[int, Collider]]:
    links = {
        f"{side}_{link.name}": link.collision
        for side, arm in scene.embodiment.arms.items()
        for link in arm.links
    }
    pieces: list[tuple[int, Collider]] = []
    for index, name in enumerate(dry.names):
        body = scene.bodies.get(name)
        if name not in NEVER | {*without} and not (body and body.rides):
            collision = body.instance.shape().collision if body else links[name]
            pieces += [(index, c) for c in collision]
    return pieces


TAIL = 0.25  # s after the meeting for which the target must stay in workspace and view

END_SPEED = 3.0
"""Times alpha: the fastest target at the meeting, where the average bound of levels 2 and 3 allows
any speed (up to 72 alpha in short last pieces)."""

JUMP = 4.0
"""Times alpha: the greatest jump of a level-3 target's velocity under `jumps: capped`. Of the
paper's shapes over 3 s, 9 of 100 exceed it at alpha 0.1 and 20 at 0.3: only a blow does that."""

LATE = (1.0, 0.8, 0.64, 0.5, 0.4, 0.3, 0.24)
"""Shares of the time until the meeting for which the target moves under `start: late`, in order."""

FAST = 0.1  # m/s; the alpha beyond which strict rules start targets late and cap jumps


def strictness(setup: Setup, alpha: float) -> tuple[tuple[float, ...], float | None]:
    """Shares of the time for which a target may move, and the greatest velocity jump (m/s) at level
    3.
    """
    fast = setup.rules == "strict" and alpha > FAST
    start = setup.start or ("late" if fast else "early")
    jumps = setup.jumps or ("capped" if fast else "drawn")
    return LATE if start == "late" else LATE[:1], JUMP * alpha if jumps == "capped" else None


def back_calculate(scene: Scene, dry: DryRun, setup: Setup) -> TargetMotion:
    """Draw the motions of all moving bodies. Raises Failure: no_motion."""
    task, clear = scene.task, Clearance(scene, dry)
    at = {n: relative(scene, n) for n, model in task.movers.items() if model == CARRIED}
    clear_of = {name: beside(scene, dry, name, {}) for name in at}

    def rides(name: str, rider: Rider) -> bool:
        """Whether the body is clear of all, and in the first image, as the target is."""
        first = middle(rider.pose(0.0), scene.bodies[name].instance)
        return bool(scene.sees(first, setup.camera)) and clear_of[name](rider)

    mover = Mover(task.target, setup.motion or task.motion, "target_motion", tuple(at))
    found = _drawn(
        scene,
        dry,
        setup,
        mover,
        lambda motion: (
            clear.free(motion) and all(rides(n, Rider(motion, p)) for n, p in at.items())
        ),
    )
    others: dict[str, TargetMotion] = {n: Rider(found, pose) for n, pose in at.items()}
    for name, model in task.movers.items():
        if name in at:
            continue
        apart = beside(scene, dry, name, {task.target: found, **others})
        others[name] = _drawn(scene, dry, setup, Mover(name, model, f"motion/{name}"), apart)
    return Company(found, others) if others else found


def relative(scene: Scene, name: str) -> Pose:
    """The pose (7,) of a body relative to the target at the meeting."""
    return compose(inverse(scene.bodies[scene.task.target].pose), scene.bodies[name].pose)


class Mover(NamedTuple):
    """A body that moves by a model, with `company` on it."""

    name: str
    model: str
    purpose: str
    company: tuple[str, ...] = ()


def _drawn(scene: Scene, dry: DryRun, setup: Setup, mover: Mover, free: Free) -> TargetMotion:
    """A free motion of one body, seen by the head camera all along."""
    spec, body = scene.spec, scene.bodies[mover.name]
    half = middle(body.pose, body.instance) - body.pose[:3]
    own = quat_rotate(inverse(body.pose)[3:], half)

    def seen(path: Floats) -> Bools:
        """Whether the camera sees the body's middle all along paths of positions or of poses."""
        middles = half if path.shape[-1] == 3 else quat_rotate(path[..., 3:], own)
        points = path[..., :3] + middles
        return np.asarray(scene.sees(points, setup.camera).all(-1))

    moving, jump_limit = strictness(setup, spec.alpha)
    carried = [scene.bodies[name] for name in mover.company]
    try:
        request = MotionRequest(
            spec.level if spec.moving else 0,
            spec.alpha,
            dry.meeting,
            body.pose,
            scene.task.workspace,
            visible=seen,
            free=free,
            lead=setup.lead,
            tail=TAIL,
            end_speed_limit=END_SPEED * spec.alpha,
            jump_limit=jump_limit,
            moving=moving,
            speed_bound=setup.speed_bound,
            radius=body.instance.shape().footprint_radius(),
            floor=TABLE_TOP,
            height=float(np.ptp(body.instance.shape().aabb()[:, 2])),
            company=tuple(
                (*b.pose[:2].tolist(), b.instance.shape().footprint_radius()) for b in carried
            ),
        )
        streams = Streams(spec.slot_rng(mover.purpose), spec.rng(mover.purpose))
        return back_calculate_motion(request, streams, mover.model)
    except NoMotion as no:
        raise Failure("back_calculate", "no_motion", str(no), drawn=no.features) from no
