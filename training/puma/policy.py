"""A trained policy that acts: history by simulated time, one network pass a chunk, and how chunks
follow each other."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import batched
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.data.setup import Setup
from pipeline.evaluate.policies.contract import Contract
from pipeline.evaluate.policies.policy import BatchPolicy, Observation, PolicyError, Start
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.trial import Trial
from pipeline.evaluate.serving.history import CLOCK_TOLERANCE, Recent
from pipeline.poses import Floats
from training.puma import checkpoint
from training.puma.config import Config, Execute
from training.puma.corpus.samples import references
from training.puma.finding.tools import tools_of
from training.puma.model.inputs import Inputs, inputs_of, stacked
from training.puma.model.oracle import oracle_numbers
from training.puma.model.puma import Puma
from training.puma.preprocess import Preprocessing
from training.puma.track import Tracks, aims

SURE = 0.8
"""How likely another choice of arms must be to replace the one that was made, and a touch to be
believed."""

STILL = 0.03
"""Speed (m/s) of a track below which the target counts as still."""


@dataclass(eq=False)
class Chunk:
    """Joint targets (K,A) in rad, the first for the control period that begins at `time` (s)."""

    time: float
    actions: Floats


@dataclass(eq=False)
class Memory:
    """What a policy remembers of one episode.

    Glances, the tracks, which arms act, whether the target was touched,
    chunks that still matter, when the next one is `due` (s), and the number of network passes.
    """

    past: Recent
    track: Tracks | None = None
    choice: int | None = None
    touched: bool = False
    chunks: list[Chunk] = field(default_factory=list[Chunk])
    due: float = 0.0
    inferences: int = 0


class PumaPolicy(BatchPolicy):
    """A policy as `domino-data evaluate` and its servers take it.

    Between two chunks it answers with as many actions as lie between two images that its history
    needs. Every pass of the network has `execute.batch` rows, filled up with copies. With one row,
    answers together are the bits of answers alone; with more, the place of a row may change the
    last bits (1e-6 measured on a processor).
    """

    _episode: Memory

    def __init__(
        self,
        network: Puma,
        preprocessing: Preprocessing,
        execute: Execute | None = None,
        device: str = "auto",
    ) -> None:
        self.config: Config = network.config
        self.preprocessing, self.execute = preprocessing, execute or network.config.execute
        self._device = (
            ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
        )
        self._network, self._forward = network.to(self._device).eval(), network
        looks = preprocessing.history != "none"
        self.period = (
            math.gcd(preprocessing.stride, self.execute.actions) if looks else self.execute.actions
        )
        self.period = 1 if preprocessing.sight else self.period
        self.setup = Setup.parse(preprocessing.setup) if preprocessing.setup else None
        self.contract = Contract(
            preprocessing.names, preprocessing.source_sizes, preprocessing.fps, self.period
        )
        self._reach = preprocessing.history_length * preprocessing.stride / preprocessing.fps
        self._episode = Memory(Recent(self._reach))

    @classmethod
    def load(
        cls, folder: Path, device: str = "auto", compiled: bool = False, batch: int | None = None
    ) -> "PumaPolicy":
        """The policy of a checkpoint, or of the newest one of a run; `batch` replaces
        `execute.batch`. Raises TrainError."""
        held = checkpoint.load(folder)
        kind = OraclePolicy if held.config.model.oracle else cls
        execute = None if batch is None else held.config.execute.model_copy(update={"batch": batch})
        policy = kind(held.model(), held.preprocessing, execute, device)
        if compiled:
            policy.compile()
        return policy

    def compile(self) -> None:
        """Compile the network for its static shapes; on a GPU as one CUDA graph. The first answers
        are slow."""
        mode = "reduce-overhead" if self._device != "cpu" else "default"
        self._forward = torch.compile(self._network, mode=mode, dynamic=False)

    def begin(self, start: Start) -> Memory:
        """Begin an episode. Raises PolicyError for another robot."""
        if start.embodiment not in self.preprocessing.embodiments:
            raise PolicyError(
                f"robot: the policy has {', '.join(self.preprocessing.embodiments)}, the evaluation"
                f" {start.embodiment}"
            )
        sight, track = self.preprocessing.sight, self.config.model.track
        if sight is None or track is None:
            return Memory(Recent(self._reach))
        return Memory(Recent(self._reach), Tracks(sight, track.bodies, track.memory))

    def act_together(self, asked: Sequence[tuple[Memory, Observation]]) -> list[Floats]:
        """The next `period` joint targets (period,A) of each episode."""
        step = 1 / self.preprocessing.fps
        if self.preprocessing.history != "none":
            for memory, seen in asked:
                memory.past.add(
                    seen.time, self.preprocessing.glance(seen.images[self.preprocessing.cameras[0]])
                )
        for memory, seen in asked:
            if memory.track is not None and self._network.finder is not None:
                [points], [errors] = self._network.finder.find(
                    seen.images[self.preprocessing.cameras[0]][None],
                    self._network.words.ids([seen.instruction]),
                )
                memory.track.see(seen.time, points, errors)
        due = [
            (memory, seen)
            for memory, seen in asked
            if not memory.chunks or seen.time >= memory.due - CLOCK_TOLERANCE
        ]
        for (memory, seen), actions in zip(due, self.plan_together(due), strict=True):
            memory.chunks.append(Chunk(seen.time, actions))
            memory.inferences += 1
            executed = self.execute.actions
            if memory.track is not None and memory.track.speed < STILL:
                executed = self.execute.still or executed
            memory.due = seen.time + executed * step
            memory.chunks = [
                chunk for chunk in memory.chunks if chunk.time + len(actions) * step > seen.time
            ]
        return [
            np.stack([self._action(memory, seen.time + i * step) for i in range(self.period)])
            for memory, seen in asked
        ]

    def arrays(self, memory: Memory, observation: Observation) -> dict[str, NDArray[Any]]:
        """The arrays of one sample, as `training.puma.corpus.samples.batch_of` makes them from the
        cache."""
        prep, model = self.preprocessing, self.config.model
        cameras = prep.cameras if model.looks else ()
        out: dict[str, NDArray[Any]] = {
            f"image_{c}": prep.image(observation.images[c])[None] for c in cameras
        }
        out["state"] = prep.state.forward(np.asarray(observation.joints, np.float32))[None]
        out["clock"] = np.array([observation.time], np.float32)
        if model.history != "none":
            ages = np.arange(prep.history_length, -1, -1) * prep.stride / prep.fps
            found = [memory.past.at(observation.time - age) for age in ages]
            out["past"] = prep.past([glance for _, glance in found])[None]
            shown = found[:-1] if model.history == "frames" else found[1:]
            out["past_time"] = np.array([[t - observation.time for t, _ in shown]], np.float32)
        if memory.track is not None:
            out["track"] = memory.track.numbers[None]
            out["tools"] = tools_of(prep.embodiments[0], observation.joints[None])
            self._decide(memory, out, observation.instruction)
        if model.arms:
            out["choice"] = np.array([memory.choice])
        if model.touched:
            out["free"] = np.array([not memory.touched])
        return out

    def given(self, observation: Observation) -> dict[str, NDArray[Any]]:
        """The arrays of an observation in the single episode."""
        return self.arrays(self._episode, observation)

    def inputs(self, observation: Observation) -> Inputs:
        """What the network is given in the single episode."""
        return self._inputs(self._episode, observation)

    def plan(self, observation: Observation) -> Floats:
        """A chunk (K,A) of joint targets in rad in the single episode."""
        return self.plan_together([(self._episode, observation)])[0]

    def plan_together(self, asked: Sequence[tuple[Memory, Observation]]) -> list[Floats]:
        """A chunk (K,A) of joint targets in rad for each episode."""
        inputs, out = (
            [self._inputs(memory, seen) for memory, seen in asked],
            dict[int, NDArray[np.float32]](),
        )
        # sentences of one length together: padding, too, changes how a row is rounded
        for length in sorted({rows.text.shape[1] for rows in inputs}):
            alike = [i for i, rows in enumerate(inputs) if rows.text.shape[1] == length]
            for some in batched(alike, self.execute.batch):
                filled = [*some, *[some[0]] * (self.execute.batch - len(some))]
                with torch.inference_mode():
                    found = self._forward(
                        stacked([inputs[i] for i in filled]).to(self._device)
                    ).actions
                out |= dict(zip(some, found.float().cpu().numpy(), strict=False))
        return [self._targets(out[i], seen) for i, (_, seen) in enumerate(asked)]

    def _decide(self, memory: Memory, out: Mapping[str, NDArray[Any]], sentence: str) -> None:
        """Which arms act, and whether the target has been touched, by the arrays of one sample."""
        network, track = self._network, self.config.model.track
        if track is None:
            return
        given = aims(out["track"], out["tools"], track.bodies, track.near)
        seen = torch.from_numpy(given).to(self._device)
        with torch.inference_mode():
            told = network.finder and network.finder.read(network.words.ids([sentence]))
            if self.config.model.arms and (memory.choice is None or self._may_choose(out)):
                likely = network.choose(seen, told)[0].softmax(-1).cpu().numpy()
                best = int(likely.argmax())
                if memory.choice is None or likely[best] > SURE:
                    memory.choice = best
            if self.config.model.touched and not memory.touched:
                state = torch.from_numpy(out["state"]).to(self._device)
                memory.touched = float(network.touch(seen, state, told).sigmoid()) > SURE

    def _may_choose(self, out: Mapping[str, NDArray[Any]]) -> bool:
        """Whether the arms may still change, by the arrays of one sample."""
        choosing = self.config.model.choosing
        return choosing is None or float(out["clock"][0]) <= choosing

    def _inputs(self, memory: Memory, observation: Observation) -> Inputs:
        return inputs_of(
            self.arrays(memory, observation),
            [observation.instruction],
            self.config,
            self._network.words,
        )

    def _targets(self, normalised: NDArray[np.float32], observation: Observation) -> Floats:
        """Joint targets (K,A) in rad of what the network answered to an observation."""
        actions = self.preprocessing.action.backward(normalised)
        if self.config.model.offsets:
            actions = actions + references(observation.joints, self.preprocessing.names)
        grippers = [
            i for i, name in enumerate(self.preprocessing.names) if name.endswith("gripper")
        ]
        actions[:, grippers] = actions[:, grippers].clip(0, 1)
        return actions

    def _action(self, memory: Memory, time: float) -> Floats:
        """The joint targets (A,) of the control period that begins at `time`."""
        rate, chunks = self.preprocessing.fps, memory.chunks
        covering = [(c, round((time - c.time) * rate)) for c in chunks]
        rows = [c.actions[i] for c, i in covering if 0 <= i < len(c.actions)]
        if not rows:
            return chunks[-1].actions[-1]
        if self.execute.ensemble is not None:
            weights = np.exp(-self.execute.ensemble * np.arange(len(rows)))
            return np.average(rows, axis=0, weights=weights)
        since = round((time - chunks[-1].time) * rate)
        if len(rows) > 1 and since < self.execute.blend:
            share = (since + 1) / (self.execute.blend + 1)
            return share * rows[-1] + (1 - share) * rows[-2]
        return rows[-1]


class OraclePolicy(PumaPolicy):
    """A policy that receives the target's future: an upper bound, evaluated as one that sees the
    truth."""

    future: Callable[[Floats], NDArray[Any]] | None = None
    """World poses (T,7) of the target at times (T,), s."""

    def see(self, trial: Trial, case: Case) -> None:
        """The trial that begins."""
        self.future = trial.motion.pose

    def arrays(self, memory: Memory, observation: Observation) -> dict[str, NDArray[Any]]:
        """As of every policy, and `oracle` (1,F)."""
        assert self.future is not None
        fps = self.preprocessing.fps
        poses = self.future(observation.time + np.arange(self.config.model.chunk + 1) / fps)
        told = oracle_numbers(poses[None].astype(np.float32), fps)
        return super().arrays(memory, observation) | {"oracle": told}
