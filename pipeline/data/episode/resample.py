"""A state log at another rate, by linear interpolation."""

from dataclasses import replace
from fractions import Fraction
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.clock import PHYSICS_HZ
from pipeline.poses import Floats, between

from .state_log import StateLog


def frames_at(length: int, fps: int, rate: int) -> Floats:
    """The fractional frame indices (N,) at `rate` of a log at `fps`. Raises ValueError if it
    does not divide the physics rate.
    """
    if rate < 1 or PHYSICS_HZ % rate:
        raise ValueError(f"{rate} frames a second do not divide {PHYSICS_HZ}, the physics rate")
    step = Fraction(fps, rate)
    count = int((length - 1) / step) + 1
    return np.array([float(k * step) for k in range(count)])


def resample_log(log: StateLog, fps: int, rate: int) -> StateLog:
    """The log of `fps` frames a second at `rate`, which divides the physics rate.

    Joints, velocities and positions are linear between frames. A command is the drive target at the
    end of its interval. A contact belongs to the interval that holds its end.
    """
    at = frames_at(len(log), fps, rate)
    ends = at + fps / rate

    def linear(values: NDArray[Any]) -> Floats:
        return _linear(values, at)

    def commands(values: Floats) -> Floats:
        return _linear(np.vstack([log.state[:1], values]), ends)

    spin, expert, acting = log.target_angular_velocity, log.expert_action, log.intervention
    return replace(
        log,
        times=log.times[0] + np.arange(len(at)) / rate,
        poses=between(log.poses, at),
        qpos=linear(log.qpos),
        qvel=linear(log.qvel),
        state=linear(log.state),
        action=commands(log.action),
        tcp=between(log.tcp, at),
        target_velocity=linear(log.target_velocity),
        contacts=_contacts_at(log.contacts, Fraction(rate, fps), len(at)),
        target_angular_velocity=None if spin is None else linear(spin),
        intervention=None if acting is None else acting[at.astype(int)],
        expert_action=None if expert is None else commands(expert),
    )


def _contacts_at(contacts: NDArray[np.void], ratio: Fraction, frames: int) -> NDArray[np.void]:
    """Contacts at `ratio` times the rate, in `frames` frames. A lower rate keeps the strongest
    of each pair of bodies.
    """
    ends = [int(frame) * ratio for frame in contacts["frame"]]
    if ratio > 1:
        places = [range(max(0, floor(end - ratio) + 1), floor(end) + 1) for end in ends]
        held = np.repeat(contacts, [len(place) for place in places])
        held["frame"] = [frame for place in places for frame in place]
    else:
        held = contacts.copy()
        held["frame"] = [min(ceil(end), frames - 1) for end in ends]
    held = held[np.lexsort([-held["impulse"], held["b"], held["a"], held["frame"]])]
    return held[np.unique(held[["frame", "a", "b"]], return_index=True)[1]]


def _linear(values: NDArray[Any], at: Floats) -> Floats:
    """Values (T,...) at places (N,) in frames, constant beyond the last."""
    at = np.minimum(at, len(values) - 1)
    low = np.floor(at).astype(int)
    share = (at - low).reshape(-1, *[1] * (values.ndim - 1))
    mixed = values[low] + (values[np.minimum(low + 1, len(values) - 1)] - values[low]) * share
    return np.where(share == 0, values[low], mixed)
