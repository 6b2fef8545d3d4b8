"""The success conditions between two recorded frames: lift and hold, at every physics step."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.state_log import CONTACT_DTYPE, StateLog
from pipeline.stages.scene import Scene
from pipeline.tasks.outcome import Outcome
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Simulation


class Watched(Outcome):
    """An outcome whose highest rises are those of every physics step; `peaks` (m) are greatest
    heights of origins by body."""

    def __init__(self, scene: Scene, log: StateLog, peaks: Mapping[str, float]) -> None:
        super().__init__(log, scene.bodies, scene.embodiment, scene.task.target, scene.rules)
        self.peaks = peaks

    def highest_rise(self, name: str) -> float:
        recorded = super().highest_rise(name)
        return max(recorded, self.peaks.get(name, -np.inf) - float(self.pose(name, 0)[2]))


class StepConditions:
    """Call `after_step` behind every physics step."""

    def __init__(self, scene: Scene, simulation: Simulation, recorder: Recorder) -> None:
        self._scene, self._simulation, self._recorder = scene, simulation, recorder
        # only the condition `was_lifted` asks for heights between frames
        lifted = [scene.task.manipulated] if "lift" in scene.task.limits else []
        self._peaks = dict.fromkeys(lifted, -np.inf)

    def after_step(self) -> None:
        for name, peak in self._peaks.items():
            self._peaks[name] = max(peak, float(self._simulation.pose(name)[2]))

    def conditions(self) -> dict[str, bool]:
        """The success conditions of the task now: on the recorded frames and the state of this
        step."""
        log, simulation = self._recorder.log(), self._simulation
        if simulation.time > log.times[-1] + 1e-9:
            log = with_frame(log, simulation)
        return self._scene.task.conditions(Watched(self._scene, log, self._peaks), self._scene.arms)


def with_frame(log: StateLog, simulation: Simulation) -> StateLog:
    """The log (F frames) with one more frame: the simulation now, with the contacts of this
    step."""
    qpos, qvel = simulation.qpos()
    twist = simulation.target_twist()
    spin = log.target_angular_velocity
    spin = None if spin is None else _and(spin, twist[3:])
    touching = [(len(log), *contact) for contact in simulation.contacts()]
    return replace(
        log,
        times=np.append(log.times, simulation.time),
        poses=_and(log.poses, simulation.poses()),
        qpos=_and(log.qpos, qpos),
        qvel=_and(log.qvel, qvel),
        state=_and(log.state, simulation.state_vector(qpos)),
        action=np.concatenate([log.action[:-1], [simulation.command] * 2]),
        tcp=_and(log.tcp, np.stack([simulation.tcp(side) for side in log.sides])),
        target_velocity=_and(log.target_velocity, twist[:3]),
        target_angular_velocity=spin,
        contacts=np.concatenate([log.contacts, np.array(touching, dtype=CONTACT_DTYPE)]),
    )


def _and(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([rows, row[None]])
