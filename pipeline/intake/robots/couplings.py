"""How a gripper's joints follow each other in MuJoCo: one moves, others are observed."""

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from typing import Any

import numpy as np

from pipeline.poses import Floats
from pipeline.world.robots.urdf_file import Mimic, UrdfError

# positions of the driving joint, seconds at each, seconds of a step of simulation
STOPS, SETTLE, STEP = 5, 1.0, 1e-3
DAMPING = 2e-4  # N m s/rad or N s/m: little, so that weak springs win within SETTLE
HARD = 0.999  # impedance of the constraints, from 0 to 1
RATE = 1.0  # rad/s or m/s of the driving joint
STILL = 0.03  # share of the driving joint's travel, below which a joint counts as fixed
BENT = 0.1  # share of a joint's travel by which it may leave the straight line


def couplings(model: Any, name: Callable[[int], str]) -> dict[int, Mimic]:
    """How coupled joints follow a driving one, without gravity, contacts or actuators, by number; a
    multiplier of 0 fixes a joint. Raises UrdfError for joints without limits or not in proportion.
    """
    by_joint: dict[int, Mimic] = {}
    driven = _driven(model)
    for group in _groups(model):
        leader = min(group, key=lambda joint: (joint not in driven, joint))
        lower, upper = model.jnt_range[leader].tolist()
        if not (model.jnt_limited[leader] and lower < upper):
            what = "drives other joints and has no limits; give it a range"
            raise UrdfError(f"joint {name(leader)!r} {what}")
        at = np.linspace(lower, upper, STOPS)
        rows = _swept(model, leader, at, group)
        for joint in sorted(group - {leader}):
            moved = rows[:, joint]
            finite = np.isfinite(moved).all()
            slope, offset = np.polyfit(at, moved, 1).tolist() if finite else (np.nan, np.nan)
            travel = float(np.ptp(moved))
            if travel < STILL * (upper - lower):
                slope, offset = 0.0, float(moved.mean())
            elif not np.abs(slope * at + offset - moved).max() < BENT * travel:
                what = "does not follow its driving joint in proportion"
                raise UrdfError(f"joint {name(joint)!r} {what}")
            by_joint[joint] = Mimic(name(leader), slope, offset)
    return by_joint


def _swept(model: Any, leader: int, at: Floats, group: set[int]) -> Floats:
    import mujoco

    off = mujoco.mjtDisableBit
    model = copy(model)
    model.opt.disableflags |= int(off.mjDSBL_ACTUATION | off.mjDSBL_CONTACT | off.mjDSBL_GRAVITY)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.eq_solref[:, :2], model.eq_solimp[:, :2] = (5 * STEP, 1), HARD
    model.dof_frictionloss[:] = 0
    model.dof_damping[:] = DAMPING
    data = mujoco.MjData(model)
    place, speed = model.jnt_qposadr, model.jnt_dofadr
    held = [joint for joint in range(model.njnt) if joint not in group]
    rest = data.qpos[place[held]].copy()
    rows = []
    for target in at:
        for _ in range(round((SETTLE + np.ptp(at) / RATE / len(at)) / STEP)):
            data.qpos[place[held]], data.qvel[speed[held]] = rest, 0
            left = target - data.qpos[place[leader]]
            data.qpos[place[leader]] += np.clip(left, -RATE * STEP, RATE * STEP)
            data.qvel[speed[leader]] = 0
            mujoco.mj_step(model, data)
        rows.append(data.qpos[place].copy())
    return np.array(rows)


def _groups(model: Any) -> list[set[int]]:
    groups: list[set[int]] = []
    for tied in _tied(model):
        apart = [group for group in groups if not group & tied]
        groups = [*apart, tied.union(*(group for group in groups if group & tied))]
    return sorted((group for group in groups if len(group) > 1), key=min)


def _tied(model: Any) -> Iterator[set[int]]:
    """The joints of each constraint: equality, closed loop, fixed tendon."""
    connect, weld, joint, tendon = 0, 1, 2, 3  # of mjtEq
    columns = np.stack([model.eq_type, model.eq_obj1id, model.eq_obj2id], 1)
    for kind, a, b in columns.tolist():
        if kind == joint and b >= 0:
            yield {a, b}
        elif kind in (connect, weld):
            yield _joints_above(model, a) ^ _joints_above(model, b)
        elif kind == tendon:
            yield {j for one in (a, b) if one >= 0 for j in _of_tendon(model, one)}
    for one in range(model.ntendon):
        yield set(_of_tendon(model, one))


def _joints_above(model: Any, body: int) -> set[int]:
    joints = set[int]()
    while body:
        first = int(model.body_jntadr[body])
        joints |= set(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return joints


def _of_tendon(model: Any, tendon: int) -> Iterable[int]:
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    return [int(model.wrap_objid[w]) for w in wraps if model.wrap_type[w] == 1]


def _driven(model: Any) -> set[int]:
    driven = set[int]()
    for kind, target in np.stack([model.actuator_trntype, model.actuator_trnid[:, 0]], 1).tolist():
        if kind == 0:
            driven.add(target)
        elif kind == 3:
            driven.update(_of_tendon(model, target))
    return driven
