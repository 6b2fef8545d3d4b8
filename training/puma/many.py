"""One network for many tasks (`make puma-many`): demonstrations in clean and randomized looks,
networks, evaluations and a table, each a command that resumes."""

import json
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.parsing import read_json, read_yaml
from pipeline.evaluate.policies.policy import Observation
from pipeline.evaluate.scoring.results import EPISODES, Results, check_episode
from pipeline.evaluate.scoring.statistics import clustered
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
    `stages` are done, and networks are evaluated under these `conditions`."""

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

    def data(self, look: str, task: str) -> Path:
        """The dataset of a task."""
        return self.out / look / task

    def run(self, network: int) -> Path:
        """The run of a network."""
        return self.out / f"network_{network}"

    def evaluation(self, network: int, condition: str) -> Path:
        """The results of a network."""
        return self.run(network) / condition.replace(" ", "_")

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
    cells = [len(many.evaluated(name)) * many.scenes_of(name) for name in many.conditions]
    counts = {
        "data": len(many.tasks) * len(many.levels) * len(LOOKS) * many.demonstrations,
        "finder": many.networks * finder,
        "policy": many.networks * policy,
        "evaluation": many.networks * len(many.tasks) * sum(cells),
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
    levels = ",".join(map(str, many.levels))
    for task in many.tasks:
        for look, options in LOOKS.items() if "data" in many.stages else ():
            out = str(many.data(look, task))
            size = ("--levels", levels, "--episodes", str(many.demonstrations))
            words = ("build", "--manifest", str(RECIPE), "--tasks", task, *size, *options)
            yield Command("domino-data", (*words, *many.workers, "--out", out), (0, 3))
            export = ("export", out, "--format", "parquet", "--labels", "poses")
            yield Command("domino-data", export)
    for network in range(many.networks):
        run = many.run(network)
        if "networks" in many.stages:
            if not checkpoint.checkpoint_path(run, many.steps[1]).exists():
                words = ("train", "--config", CONFIG, "--out", str(run), *_keys(many, network))
                yield Command("puma", words)
            yield Command("puma", ("errors", str(run)))
        for condition in many.conditions if "evaluation" in many.stages else ():
            yield from _evaluations(many, network, condition)


def _keys(many: Many, network: int) -> list[str]:
    """The settings of a network: its data, what is learned of each task, and its seed."""
    sources = [
        {"dataset": str(many.data(look, task).absolute())}
        | ({} if task in PRESSED else {"after_success": HELD})
        for task in many.tasks
        for look in LOOKS
    ]
    keys = [
        f"data.sources={json.dumps(sources)}",
        f"data.cache={many.out / 'cache'}",
        f"train.seed={network}",
        *many.settings,
    ]
    return [word for key in keys for word in ("--set", key)]


def _evaluations(many: Many, network: int, condition: str) -> Iterator[Command]:
    held, out = checkpoint.newest(many.run(network)), many.evaluation(network, condition)
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


def results(many: Many) -> list[dict[str, Any]]:
    """What has been evaluated: a row an episode, with network, condition, task, level, seed of the
    scene, success, and whether the target was met."""
    found = list[dict[str, Any]]()
    for network, condition, task in product(range(many.networks), CONDITIONS, many.tasks):
        path = many.evaluation(network, condition) / task / EPISODES
        found += [
            {"network": network, "condition": condition, "task": task}
            | {name: row[name] for name in ("level", "seed", "success")}
            | {"met": row.get("meeting") is not None}
            for row in (Results(path, check_episode).rows() if path.exists() else ())
        ]
    return found


def table(many: Many) -> str:
    """Success rates by condition, task and level, then of all tasks, networks together, with 95 %
    intervals that are clustered by scene."""
    cells = defaultdict[tuple[str, str, int], list[dict[str, Any]]](list)
    found = results(many)
    for row in found:
        cells[row["condition"], row["task"], row["level"]].append(row)
    for row in found:
        cells[row["condition"], "all tasks", row["level"]].append(row)
    lines = [
        "| condition | task | level | met | solved | SR % (95 %) |",
        "|---|---|---:|---:|---:|---|",
    ]
    for (condition, task, level), tried in cells.items():
        scenes = defaultdict[tuple[str, int], list[bool]](list)
        for row in tried:
            scenes[row["task"], row["seed"]].append(row["success"])
        low, high = clustered([(sum(won), len(won)) for won in scenes.values()])
        met, solved = (sum(row[name] for row in tried) for name in ("met", "success"))
        rate = f"{100 * solved / len(tried):.0f} ({100 * low:.0f}-{100 * high:.0f})"
        head = f"| {condition} | {task} | {level} | {met} | {solved} of {len(tried)} | {rate} |"
        lines.append(head)
    return "\n".join(lines)
