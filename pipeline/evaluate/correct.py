"""Corrections: a policy acts, the reactive expert labels every frame (DAgger, Ross et al. 2011),
takes over, and finishes.

It takes over at a drawn time (`time`), or at a drawn distance of the hand from its path
(`error`; HG-DAgger, Kelly et al. 2019). Before that `perturb` holds or pushes the robot."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.data.names import SIDES
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.expert.reactive.actor import ReactiveActor
from pipeline.expert.reactive.advice import Adviser
from pipeline.motion.contract import TargetMotion
from pipeline.poses import Floats
from pipeline.stages.dry_run import DryRun
from pipeline.stages.failure import Failure, failing_as
from pipeline.stages.replay import Replay, finish
from pipeline.stages.scene import Scene
from pipeline.world.robots import get_embodiment

from .actions import ActionError
from .asking import AskedPolicy
from .episode import start_of
from .names import policy_name
from .policies.contract import check_contract
from .policies.policy import NoAnswer, PolicyError, observe
from .scenes.case import Case, blind
from .scenes.trial import Eyes, Trial, instruction_of

STAGE = "correct"

ASTRAY = (0.02, 0.06)  # m from its path, at which an expert that waits for an error takes over
LATE = 2.0  # planned meetings after which it takes over at the latest
HELD = (0.3, 1.0)  # range (s) of a perturbation
PUSHED = 0.08  # standard deviation (rad or m) of a push of each arm joint
STIRRED = 1e-3  # m at which a body counts as moved by the policy


@dataclass(frozen=True)
class Correction:
    recipe: Recipe

    def describe(self) -> dict[str, Any]:
        corrections = self.recipe.corrections
        return {"expert": "reactive", "corrects": corrections.label if corrections else ""}

    def check(self) -> None:
        recipe = self.recipe
        try:
            asked = _ask_policy(recipe)
            setup = _choose_setup(asked, recipe)
            for robot in recipe.embodiments:
                check_contract(asked.policy, start_of(get_embodiment(robot), setup, ""))
        except PolicyError as error:
            raise PolicyError(str(error).replace("--policy", "--corrections", 1)) from error

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        """The rollout, with the acting one and the expert's command in every frame. Raises
        PolicyError, and Failure: takeover_late, no_error, policy_failed, and those of
        stages/replay.py."""
        recipe = self.recipe
        actor = scene.start(motion, fps, STAGE, ReactiveActor)
        actor.recorder.watched = SIDES
        with failing_as(STAGE, actor):
            actor.attend(recipe.sight, scene.task, scene.spec.rng("sight"))
            case = Case(scene.spec, motion.to_json(), dry.meeting, 0, "", "", recipe.physics)
            labels = _Turn(recipe, Trial(scene, motion, recipe, actor), actor, case).take()
            actor.meet(scene.task.meet)
            done = finish(scene, actor, STAGE)
        log, frames = done.log, len(labels)
        rows = np.array(labels).reshape(frames, log.action.shape[1])
        expert = np.concatenate([rows, log.action[frames:]])
        acted = np.arange(len(log)) >= frames
        return replace(done, log=replace(log, intervention=acted, expert_action=expert))


def _ask_policy(recipe: Recipe) -> AskedPolicy:
    corrections = recipe.corrections
    if corrections is None:
        raise PolicyError("the recipe names no policy to correct")
    name = policy_name(corrections.policy)
    if name.label != corrections.label:
        changed = f"is {name.label}, not {corrections.label} any more"
        raise PolicyError(f"--corrections {corrections.policy}: {changed}")
    return AskedPolicy(name)


def _choose_setup(asked: AskedPolicy, recipe: Recipe) -> Setup:
    """A policy that is shown the simulation sees no images."""
    return blind(recipe) if asked.sees_truth else recipe.setup


class _Turn:
    def __init__(self, recipe: Recipe, trial: Trial, actor: ReactiveActor, case: Case) -> None:
        self._trial, self._actor, self._recipe = trial, actor, recipe
        self._asked, self._case, meeting = _ask_policy(recipe), case, case.meeting
        rng = trial.scene.spec.rng("takeover")
        self._last = LATE * meeting if recipe.takeover == "error" else rng.uniform(0.0, meeting)
        self._astray = rng.uniform(*ASTRAY) if recipe.takeover == "error" else np.inf
        others = (name for name in actor.bodies if name != trial.scene.task.target)
        self._bodies = {name: actor.pose(name) for name in others}
        self._adviser: Adviser | None = None

    def take(self) -> list[Floats]:
        setup = _choose_setup(self._asked, self._recipe)
        eyes = Eyes(self._trial.scene, setup) if setup.cameras else None
        words, labels = instruction_of(self._trial.scene, "seen"), list[Floats]()
        try:
            start = start_of(self._trial.scene.embodiment, setup, words)
            self._asked.begin(start, self._trial, self._case)
            while True:
                observation = observe(self._trial, eyes, words)
                for action in self._asked.answer(observation, self._trial.length):
                    labels.append(self._advice())
                    if self._ends(len(labels) - 1):
                        return [*labels[:-1], *self._perturb(labels[-1])]
                    self._execute(action)
        except (ActionError, NoAnswer) as error:
            raise Failure(STAGE, "policy_failed", str(error)) from error
        finally:
            if eyes:
                eyes.close()

    def _advice(self) -> Floats:
        """To hold still until the expert has seen the target move."""
        if self._actor.simulation.time < self._actor.watched_for - 1e-9:
            return self._actor.simulation.command.copy()
        if self._adviser is None:
            self._adviser = Adviser(self._actor, self._trial.scene.task.meet, self._recipe.fps)
        return self._adviser.action()

    def _perturb(self, first: Floats) -> list[Floats]:
        """Hold or push the robot; the expert's commands (A,)."""
        if self._recipe.perturb is None:
            return []
        rng, names = self._trial.scene.spec.rng("perturb"), self._trial.limits.names
        frames = max(1, round(rng.uniform(*HELD) * self._recipe.fps))
        arms = np.array([not name.endswith("gripper") for name in names])
        push = PUSHED * rng.normal(size=len(names)) * arms * (self._recipe.perturb == "push")
        start, labels = self._actor.simulation.command, [first]
        for frame in range(1, frames + 1):
            self._execute(start + push * frame / frames)
            self._refuse_contact("takeover_late")
            labels.append(self._advice())
        return labels[:-1]

    def _ends(self, frames: int) -> bool:
        self._refuse_contact("no_error" if self._recipe.takeover == "error" else "takeover_late")
        if self._actor.simulation.time >= self._last - 1e-9:
            return frames > 0
        return frames > 0 and self._adviser is not None and self._adviser.off > self._astray

    def _refuse_contact(self, reason: str) -> None:
        """Raise Failure for a touched target (this reason) or a moved body."""
        if by := self._actor.simulation.touched_by:
            what = f"{by} touched the {self._trial.scene.task.target}"
            raise Failure(STAGE, reason, f"{what} before the expert took over")
        for name, pose in self._bodies.items():
            if np.linalg.norm(self._actor.pose(name)[:3] - pose[:3]) > STIRRED:
                raise Failure(STAGE, "takeover_late", f"the policy moved the {name} before")

    def _execute(self, action: Floats) -> None:
        rows, velocity = self._trial.targets(action)
        for row in rows:
            self._actor.advance(row, velocity)
