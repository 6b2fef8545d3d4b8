"""The DOMINO paper's closed-loop experiments and printed rows (table.yaml), beside ours."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.parsing import read_yaml
from pipeline.evaluate.scoring.compare import newest
from pipeline.evaluate.scoring.summary import Row, over_tasks
from pipeline.tasks.contract import expand_tasks
from training.puma.errors import TrainError

TEN = (
    *("grab_roller", "handover_block", "place_a2b_left", "place_can_basket", "shake_bottle"),
    *("beat_block_hammer", "move_pillbottle_pad", "place_bread_basket", "place_container_plate"),
    "press_stapler",
)

EPISODES = 100  # of a task


@dataclass(frozen=True)
class PaperRow:
    """Success rate (%) and score over a category's tasks at a level."""

    method: str
    success_rate: float
    manipulation_score: float
    level: int = 1
    category: str = "all"


@dataclass(frozen=True)
class Experiment:
    """An experiment on aloha, in the domain clean. `trained` is the policies' training data."""

    title: str
    trained: str
    rows: tuple[PaperRow, ...]
    tasks: tuple[str, ...] = ("all",)
    alpha: tuple[float, ...] = (0.1,)

    def words(self) -> tuple[str, ...]:
        """The options of `domino-data evaluate` with which the experiment is tried here."""
        levels = ",".join(map(str, sorted({row.level for row in self.rows})))
        return (
            *("--tasks", ",".join(self.tasks), "--levels", levels, "--embodiment", "aloha"),
            *("--alpha", ",".join(map(str, self.alpha)), "--rules", "domino"),
            *("--cameras", "head,left,right"),
        )


def _read() -> dict[str, Experiment]:
    table = read_yaml(Path(__file__).with_suffix(".yaml"))
    return {
        name: Experiment(
            values["title"],
            values["trained"],
            tuple(PaperRow(*row) for row in values["rows"]),
            TEN if values.get("tasks") == "ten" else ("all",),
            tuple(values.get("alpha", [0.1])),
        )
        for name, values in table.items()
    }


EXPERIMENTS = _read()


def experiment(name: str) -> Experiment:
    """An experiment by name. Raises TrainError with the names there are."""
    if name not in EXPERIMENTS:
        raise TrainError(f"{name!r} is no experiment of the paper: choose {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]


def beside(published: Experiment, means: Sequence[Row]) -> list[Row]:
    """Each group's rows (level and category) after that of `means`."""
    out = list[Row]()
    for level, category in dict.fromkeys((row.level, row.category) for row in published.rows):
        head = {"level": level, "category": category}
        numbers = ("success_rate", "manipulation_score")
        keys = (*numbers, *(f"{name}_interval" for name in numbers))
        for m in means:
            if (m["level"], m["category"]) == (level, category):
                values = {key: m[key] for key in keys}
                out.append(head | {"method": m["policy"], "paper": False} | values)
        for row in published.rows:
            if (row.level, row.category) == (level, category):
                values = {name: getattr(row, name) for name in numbers}
                out.append(head | {"method": row.method, "paper": True} | values)
    return out


def differences(published: Experiment, episodes: int, rules: str, clock: str) -> list[str]:
    out = [
        "scenes, objects and robot models are ours, and so is the simulation",
        f"the paper's policies learned from {published.trained} of the paper's data",
    ]
    if episodes != EPISODES:
        out.append(f"{episodes} scenes a task, not {EPISODES}")
    if not rules.startswith("domino"):
        out.append(f"rules {rules}: conditions of success are not the paper's (--rules domino)")
    if clock != "step-locked":
        out.append(
            f"clock {clock}: in the paper's code the target moves by a fixed time a policy step"
            " (--clock step-locked)"
        )
    return out


def printed(name: str, out: Path) -> Iterator[str]:
    """Lines of a table: the rows of an evaluation in `out` beside those of an experiment, and what
    differs. Raises TrainError, CompareError."""
    published = experiment(name)
    tasks = {*expand_tasks(published.tasks)}
    means = over_tasks([row for row in newest(out) if row["task"] in tasks])
    rows = beside(published, means)
    if all(row["paper"] for row in rows):
        raise TrainError(
            f"{out}: no task of it is in the paper's table {name!r}, which needs `domino-data"
            f" evaluate {' '.join(published.words())}`"
        )
    yield f"{published.title}\n"
    for row in rows:
        method = row["method"] if row["paper"] else f"-> {row['method']}"
        scores = (_number(row, key) for key in ("success_rate", "manipulation_score"))
        yield f"{method:32} {row['level']} {row['category']:13} {'  '.join(scores)}"
    first = means[0]
    apart = differences(
        published, first["episodes"] // first["tasks"], first["rules"], first["clock"]
    )
    yield from ("\n-> differs from the paper:", *(f"   {line}" for line in apart))


def _number(row: Row, key: str) -> str:
    if row["paper"]:
        return f"{row[key]:g}"
    low, high = row[f"{key}_interval"]
    return f"{row[key]:.1f} ({low:.1f}-{high:.1f})"
