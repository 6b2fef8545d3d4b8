"""Experiments of the DOMINO paper as commands: data, networks and the rows printed beside theirs.

Every step is a command of `domino-data` or `puma` that resumes, so an experiment that was stopped
is resumed by the same words.
"""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from training.puma.errors import TrainError
from training.puma.experiments.table import experiment

STILL, MOVING = "level = 0", "level > 0"


@dataclass(frozen=True)
class PaperNetwork:
    """A row: the configuration's name after `puma-4b` or `puma-tiny`, which episodes it learns from
    (a part of the mixture each), and the network it begins with."""

    label: str
    config: str = ""
    where: tuple[str, ...] = ("",)
    start: str = ""


@dataclass(frozen=True)
class PaperStudy:
    """Recipe (manifests/paper/), networks, and its experiment in table.yaml."""

    manifest: str
    networks: tuple[PaperNetwork, ...]
    table: str


BASELINE, PUMA = PaperNetwork("baseline", "-baseline"), PaperNetwork("PUMA")
BOTH = (STILL, MOVING)

STUDIES = {
    "main": PaperStudy("35-tasks", (BASELINE, PUMA), "main"),
    "task-type": PaperStudy("35-tasks", (BASELINE, PUMA), "task-type"),
    "strategies": PaperStudy(
        "static-and-dynamic",
        (PaperNetwork("S", "-baseline", (STILL,)), PaperNetwork("D", "-baseline", (MOVING,))),
        "strategies",
    ),
    "mixture": PaperStudy(
        "static-and-dynamic",
        (
            PaperNetwork("baseline-D", "-baseline", (MOVING,)),
            PaperNetwork("baseline-S-D", "-baseline", BOTH),
            PaperNetwork("PUMA-D", "-n2", (MOVING,)),
            PaperNetwork("PUMA-S-D", "-n2", BOTH),
        ),
        "mixture",
    ),
    "oracle": PaperStudy("35-tasks", (BASELINE, PaperNetwork("oracle", "-oracle")), "oracle"),
    "ablation": PaperStudy(
        "35-tasks",
        (
            BASELINE,
            PaperNetwork("flow", "-no-auxiliary"),
            PaperNetwork("flow-N2", "-n2"),
            PaperNetwork("frames-N2", "-raw-frames"),
            PaperNetwork("flow-N4"),
        ),
        "ablation",
    ),
    "history-aware": PaperStudy(
        "10-tasks", (PaperNetwork("ContextVLA", "-contextvla"), PUMA), "history-aware"
    ),
    "history-length": PaperStudy(
        "35-tasks", (PaperNetwork("h1", "-h1"), PaperNetwork("h4")), "history-length"
    ),
    "horizon": PaperStudy(
        "35-tasks",
        (BASELINE, PaperNetwork("N2", "-n2"), PaperNetwork("N4"), PaperNetwork("N6", "-n6")),
        "horizon",
    ),
    "cross-level": PaperStudy(
        "cross-level",
        (
            PaperNetwork("level-2", where=("level = 2",)),
            PaperNetwork("level-3", where=("level = 3",)),
            PaperNetwork("level-1", where=("level = 1",)),
            PaperNetwork("LoRA-2", "-lora", ("level = 2",), "level-1"),
            PaperNetwork("LoRA-3", "-lora", ("level = 3",), "level-1"),
        ),
        "cross-level",
    ),
    "slow": PaperStudy("10-tasks", (PUMA,), "slow"),
    "random-alpha": PaperStudy("10-tasks", (PUMA,), "random-alpha"),
    "double": PaperStudy("double", (PUMA,), "double"),
}
"""All closed-loop experiments; latency is measured by `puma bench`."""


@dataclass(frozen=True)
class Size:
    """How large an experiment is run. `options` are those of `build`, `settings` those of
    `train`."""

    base: str = "puma-4b"
    options: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    masks: tuple[str, ...] = ("--stages", "flow,masks,features")
    table: tuple[str, ...] = ()


FULL = Size()
TINY = Size(
    "puma-tiny",
    ("--tasks", "grab_roller", "--episodes", "1", "--cameras", "head", "--segmentation"),
    ("train.steps=1", "train.batch=2", "data.validation=0"),
    ("--stages", "flow,masks", "--mask-source", "sim"),
    ("--tasks", "grab_roller", "--episodes", "1", "--cameras", "head", "--executor", "inline"),
)
"""One task, one episode a level, one step: whether every command of an experiment fits the next."""


@dataclass(frozen=True)
class Command:
    """One step: a program and its words. `good` are its exit codes."""

    program: str
    words: tuple[str, ...]
    good: tuple[int, ...] = (0,)

    def __str__(self) -> str:
        return shlex.join([self.program, *self.words])


def study(name: str) -> PaperStudy:
    """An experiment by name. Raises TrainError with the names there are."""
    if name not in STUDIES:
        raise TrainError(f"{name!r} is no experiment: choose {', '.join(STUDIES)}")
    return STUDIES[name]


def commands(
    name: str, out: Path, size: Size = FULL, settings: Sequence[str] = ()
) -> Iterator[Command]:
    """The commands of an experiment, in order, each to be run before the next one is taken.

    Raises TrainError for an experiment that does not exist."""
    from training.puma import checkpoint  # torch takes seconds to import

    found, data = study(name), str(out / "data")
    recipe = Path(__file__).parents[3] / "manifests" / "paper" / f"{found.manifest}.yaml"
    build = ("build", "--manifest", str(recipe), "--out", data, *size.options)
    yield Command("domino-data", build, (0, 3))
    yield Command("domino-data", ("annotate", data, *size.masks))
    yield Command("domino-data", ("export", data, "--format", "parquet"))
    for network in found.networks:
        run = str(out / network.label)
        sources = ", ".join(f"{{dataset: {data}, where: '{where}'}}" for where in network.where)
        keys = [f"data.sources=[{sources}]", f"data.cache={out / 'cache'}", *size.settings]
        if network.start:
            keys.append(f"train.start={out / network.start}")
        words = [word for key in (*keys, *settings) for word in ("--set", key)]
        yield Command(
            "puma", ("train", "--config", size.base + network.config, "--out", run, *words)
        )
        policy = str(checkpoint.newest(out / network.label) / "policy.py")
        # a policy that is told the future must be in the process of the simulation
        where = ("--in-process",) if network.config == "-oracle" else ()
        tried = str(out / f"table-{network.label}")
        words = (*experiment(found.table).words(), "--policy", policy, *where, "--out", tried)
        yield Command("domino-data", ("evaluate", *words, *size.table))
        yield Command("puma", ("table", found.table, tried))
