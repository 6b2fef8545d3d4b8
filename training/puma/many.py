"""One network for many tasks (`make puma-many`): demonstrations in clean and randomized looks,
networks, twins of the first one, and evaluations, each a command that resumes."""

import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow.parquet as pq

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.parsing import read_json, read_yaml
from pipeline.evaluate.policies.policy import Observation
from pipeline.poses import Floats
from training.puma import checkpoint
from training.puma.experiments.paper import Command
from training.puma.policy import Memory, PumaPolicy
from training.puma.reading import read_config

RECIPE = Path(__file__).parents[2] / "manifests" / "puma-many.yaml"
CONFIG = "puma-many"
ROBOT = "aloha"

LOOKS = {"clean": (), "randomized": ("--visuals", "randomized", "--seed", "1")}
"""The datasets of a task, and with which options they are built."""

PRESSED = ("click_bell", "click_alarmclock", "press_stapler")
"""Tasks that end with a touch by the hand, which creeps: the last moments before it are left out
(docs/training.md). Those of beat_block_hammer are the blow."""

HELD = 0.3
"""Seconds after the success that are learned in all other tasks."""

FRESH = ("--seed", "5")
"""Scenes that no choice was made on."""

SPENT = {
    "data": ("data", 1.3, "demonstrations"),
    "finder": ("networks", 0.16, "steps"),
    "policy": ("networks", 0.14, "steps"),
    "evaluation": ("evaluation", 1.5, "episodes"),
}
"""Works: their stage, core-seconds of one, and what one is."""


UNSEEN, SWAPPED = "unseen sentences", "swapped sentences"
CONDITIONS: dict[str, tuple[str, ...]] = {
    UNSEEN: (),
    "unseen looks": ("--visuals", "randomized"),
    "seen sentences": ("--instructions", "seen"),
    SWAPPED: (),
}
"""How networks are evaluated: at all levels in clean looks, by sentences that training never read;
at level 1 with one difference each. Swapped sentences are those of another task."""

POLICY = '''"""A policy that is told to do another task."""

from pathlib import Path

from training.puma.many import MisledPolicy


def make_policy() -> MisledPolicy:
    policy = MisledPolicy.load(Path({checkpoint!r}))
    policy.sentences = {sentences!r}
    return policy
'''


STAGES = ("data", "networks", "evaluation")


@dataclass(frozen=True)
class Learner:
    """A network by the name of its directory: the seed, and in what its training differs.

    With an `expert`, or if it is shown `still` targets alone, it has as many demonstrations of its
    own."""

    name: str
    seed: int = 0
    settings: tuple[str, ...] = ()
    expert: str = ""
    still: bool = False

    @property
    def folder(self) -> str:
        """The directory of its demonstrations in that of the run."""
        return self.name if self.expert or self.still else ""


TWINS = {
    twin.name: twin
    for twin in (
        Learner("no-history", settings=("model.track.memory=false", "execute.still=null")),
        Learner("planned", expert="planned"),
        Learner("static", still=True),
    )
}
"""Networks that differ from the first one of a run in one thing: they see one image at a time,
learn from the planned expert, or learn from targets that stand still."""


class MisledPolicy(PumaPolicy):
    """A policy that reads sentences of another task in place of its own."""

    sentences: Sequence[str] = ()

    def act_together(self, asked: Sequence[tuple[Memory, Observation]]) -> list[Floats]:
        """See PumaPolicy."""
        return super().act_together([(memory, self._mislead(seen)) for memory, seen in asked])

    def _mislead(self, seen: Observation) -> Observation:
        other = self.sentences[zlib.crc32(seen.instruction.encode()) % len(self.sentences)]
        return replace(seen, instruction=other)


@dataclass(frozen=True)
class Many:
    """The size of a run: tasks, levels, demonstrations of a task, level and look, networks, and
    scenes of a task and level.

    `settings` are those of `puma train`, `workers` an option of builds and evaluations. Only these
    `stages` are done, and networks are evaluated under these `conditions`, `twins` (TWINS) under
    the first one."""

    out: Path
    tasks: tuple[str, ...]
    levels: tuple[int, ...]
    demonstrations: int
    networks: int = 3
    scenes: int = 50
    settings: tuple[str, ...] = ()
    workers: tuple[str, ...] = ()
    stages: tuple[str, ...] = STAGES
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    twins: tuple[str, ...] = ()

    @classmethod
    def full(cls, out: Path) -> "Many":
        """The run of the recipe."""
        recipe = read_yaml(RECIPE)
        return cls(out, tuple(recipe["tasks"]), tuple(recipe["levels"]), recipe["episodes"])

    @property
    def steps(self) -> tuple[int, int]:
        """Steps of the finder and of the policy."""
        config = read_config(CONFIG, self.settings)
        return 0 if config.model.track is None else config.model.track.steps, config.train.steps

    @property
    def learners(self) -> tuple[Learner, ...]:
        """All networks, twins last."""
        own = (Learner(f"network_{seed}", seed) for seed in range(self.networks))
        return (*own, *(TWINS[name] for name in self.twins))

    def tried(self, learner: Learner) -> tuple[str, ...]:
        """The conditions under which a network is evaluated."""
        twin = learner.name in self.twins
        return tuple(name for name in self.conditions if name == UNSEEN or not twin)

    def data(self, look: str, task: str, folder: str = "") -> Path:
        """The dataset of a task."""
        return self.out / folder / look / task

    def run(self, learner: Learner) -> Path:
        """The run of a network."""
        return self.out / learner.name

    def evaluation(self, learner: Learner, condition: str) -> Path:
        """The results of a network."""
        return self.run(learner) / condition.replace(" ", "_")

    def evaluated(self, condition: str) -> tuple[int, ...]:
        """The levels at which networks are evaluated."""
        return self.levels if condition == UNSEEN else (max(1, min(self.levels)),)

    def scenes_of(self, condition: str) -> int:
        """Scenes of a task and level: a fifth where a policy is told to do something else."""
        return max(1, self.scenes // 5) if condition == SWAPPED else self.scenes


def estimate(many: Many) -> list[tuple[str, int, float]]:
    """Works of the stages that are done, how often each is done, and their core-hours on a core
    that does nothing else."""
    finder, policy = many.steps
    folders, cells = (
        {learner.folder for learner in many.learners},
        [
            len(many.evaluated(name)) * many.scenes_of(name)
            for learner in many.learners
            for name in many.tried(learner)
        ],
    )
    shown = len(many.tasks) * len(many.levels) * len(LOOKS) * many.demonstrations
    counts = {
        "data": len(folders) * shown,
        "finder": len(many.learners) * finder,
        "policy": len(many.learners) * policy,
        "evaluation": len(many.tasks) * sum(cells),
    }
    return [
        (name, counts[name], counts[name] * seconds / 3600)
        for name, (stage, seconds, _) in SPENT.items()
        if stage in many.stages
    ]


def commands(many: Many) -> Iterator[Command]:
    """The commands of a run in order, each to be run before the next one is taken.

    A network that has been trained is not trained again; all other commands resume in seconds.
    """
    built = set[str]()
    for learner in many.learners:
        if "data" in many.stages and learner.folder not in built:
            built.add(learner.folder)
            yield from _builds(many, learner)
        if "networks" in many.stages:
            run = many.run(learner)
            if not checkpoint.checkpoint_path(run, many.steps[1]).exists():
                words = ("train", "--config", CONFIG, "--out", str(run), *_keys(many, learner))
                yield Command("puma", words)
            yield Command("puma", ("errors", str(run)))
        for condition in many.tried(learner) if "evaluation" in many.stages else ():
            yield from _evaluations(many, learner, condition)


def _builds(many: Many, learner: Learner) -> Iterator[Command]:
    """The datasets that a network learns from; those of still targets are as large as others."""
    levels, count = many.levels, many.demonstrations
    if learner.still:
        levels, count = (0,), len(many.levels) * count
    size = ("--levels", ",".join(map(str, levels)), "--episodes", str(count))
    expert = ("--expert", learner.expert) if learner.expert else ()
    for task in many.tasks:
        for look, options in LOOKS.items():
            out = str(many.data(look, task, learner.folder))
            words = ("build", "--manifest", str(RECIPE), "--tasks", task, *size, *options)
            yield Command("domino-data", (*words, *expert, *many.workers, "--out", out), (0, 3))
            export = ("export", out, "--format", "parquet", "--labels", "poses")
            yield Command("domino-data", export)


def _keys(many: Many, learner: Learner) -> list[str]:
    """The settings of a network: its data, what is learned of each task, and its seed."""
    sources = [
        {"dataset": str(many.data(look, task, learner.folder).absolute())}
        | ({} if task in PRESSED else {"after_success": HELD})
        for task in many.tasks
        for look in LOOKS
    ]
    keys = [
        f"data.sources={json.dumps(sources)}",
        f"data.cache={many.out / 'cache'}",
        f"train.seed={learner.seed}",
        *learner.settings,
        *many.settings,
    ]
    return [word for key in keys for word in ("--set", key)]


def _evaluations(many: Many, learner: Learner, condition: str) -> Iterator[Command]:
    held, out = checkpoint.newest(many.run(learner)), many.evaluation(learner, condition)
    for number, task in enumerate(many.tasks):
        policy = held / "policy.py"
        if condition == SWAPPED:
            other = many.tasks[(number + max(1, len(many.tasks) // 2)) % len(many.tasks)]
            policy = out / f"{task}.py"
            policy.parent.mkdir(parents=True, exist_ok=True)
            text = POLICY.format(checkpoint=str(held.absolute()), sentences=_sentences(many, other))
            write_atomic(policy, text.encode())
        words = ["evaluate", "--policy", str(policy), "--like", str(held), "--tasks", task]
        words += ["--embodiment", ROBOT, "--levels", ",".join(map(str, many.evaluated(condition)))]
        words += ["--episodes", str(many.scenes_of(condition)), *FRESH, *CONDITIONS[condition]]
        words += ["--quiet", *many.workers]
        # the same scenes for all networks
        words += ["--manifests", str(many.out / "manifests"), "--out", str(out / task)]
        yield Command("domino-data", tuple(words))


def _sentences(many: Many, task: str) -> list[str]:
    """Sentences that ask for a task and that training never read, kept beside the networks."""
    kept = many.out / "sentences" / f"{task}.json"
    if kept.exists():
        return read_json(kept)
    table = Dataset(many.data("clean", task)).exports("parquet") / "episodes.parquet"
    rows = pq.read_table(table, columns=["instructions_unseen"])["instructions_unseen"].to_pylist()
    found = sorted({text for row in rows for text in row})[:100]
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(kept, json.dumps(found, indent=1).encode())
    return found
