"""The closed-loop experiments of the DOMINO paper: what is evaluated, and the rows that the paper
prints."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.data.errors import DominoError
from pipeline.evaluate.scoring.summary import Row

TEN = (
    *("grab_roller", "handover_block", "place_a2b_left", "place_can_basket", "shake_bottle"),
    *(
        "beat_block_hammer",
        "move_pillbottle_pad",
        "place_bread_basket",
        "place_container_plate",
        "press_stapler",
    ),
)
"""The representative subset of the paper's additional experiments."""

EPISODES = 100
"""Of a task in the paper."""


class PaperError(DominoError):
    """An experiment that the paper does not have."""


@dataclass(frozen=True)
class PaperRow:
    """Success rate (%) and manipulation score of a method over the tasks of a category at a
    level."""

    method: str
    success_rate: float
    manipulation_score: float
    level: int = 1
    category: str = "all"


@dataclass(frozen=True)
class Experiment:
    """`tasks` is "all" or names; all on aloha, in the domain clean. `trained` says on what the
    paper's policies learned."""

    title: str
    trained: str
    rows: tuple[PaperRow, ...]
    tasks: tuple[str, ...] = ("all",)
    alpha: tuple[float, ...] = (0.1,)

    @property
    def levels(self) -> tuple[int, ...]:
        """Levels of its rows."""
        return tuple(sorted({row.level for row in self.rows}))


EXPERIMENTS = {
    "main": Experiment(
        "main_result: 35 tasks, level 1",
        "all 35 tasks at level 1",
        (
            PaperRow("OpenVLA", 1.54, 6.10),
            PaperRow("RDT-1B", 5.34, 17.71),
            PaperRow("pi0", 8.17, 23.96),
            PaperRow("pi0.5", 9.63, 26.17),
            PaperRow("InternVLA-M1", 5.40, 27.57),
            PaperRow("Isaac-GR00T", 6.10, 28.60),
            PaperRow("VLA-Adapter", 4.40, 24.31),
            PaperRow("pi0-FAST", 3.54, 20.87),
            PaperRow("pi0-FAST (Qwen3-VL)", 5.74, 20.66),
            PaperRow("OpenVLA-OFT", 9.06, 24.06),
            PaperRow("OpenVLA-OFT (Qwen3-VL)", 10.86, 30.49),
            PaperRow("PUMA", 17.20, 34.97),
        ),
    ),
    "task-type": Experiment(
        "task_type: 35 tasks by category, level 1",
        "all 35 tasks at level 1",
        (
            PaperRow("OpenVLA-OFT", 14.3, 34.0, category="interception"),
            PaperRow("pi0.5", 11.8, 33.6, category="interception"),
            PaperRow("PUMA", 24.2, 47.9, category="interception"),
            PaperRow("OpenVLA-OFT", 2.9, 12.3, category="tracking"),
            PaperRow("pi0.5", 7.0, 17.3, category="tracking"),
            PaperRow("PUMA", 8.9, 19.6, category="tracking"),
        ),
    ),
    "history-aware": Experiment(
        "context_vla: ten tasks, level 1",
        "the ten tasks at level 1",
        (PaperRow("ContextVLA", 7.8, 20.52), PaperRow("PUMA", 20.9, 40.0)),
        TEN,
    ),
    "cross-level": Experiment(
        "cross_level: ten tasks, levels 2 and 3",
        "the ten tasks at the level itself; with LoRA at level 1 first",
        (
            PaperRow("pi0.5", 7.9, 20.76, 2),
            PaperRow("PUMA", 9.3, 27.70, 2),
            PaperRow("PUMA + LoRA", 10.5, 30.28, 2),
            PaperRow("pi0.5", 1.6, 13.39, 3),
            PaperRow("PUMA", 2.5, 15.97, 3),
            PaperRow("PUMA + LoRA", 4.6, 20.16, 3),
        ),
        TEN,
    ),
    "slow": Experiment(
        "alpha_gen: ten tasks, level 1, alpha 0.05",
        "the ten tasks at level 1, alpha 0.1",
        (PaperRow("pi0.5", 10.86, 28.29), PaperRow("PUMA", 19.91, 36.75)),
        TEN,
        (0.05,),
    ),
    "random-alpha": Experiment(
        "alpha_gen: ten tasks, level 1, an alpha of its own for every episode",
        "the ten tasks at level 1, alpha 0.1",
        (PaperRow("pi0.5", 10.49, 27.20), PaperRow("PUMA", 18.34, 36.46)),
        TEN,
        (0.06, 0.08, 0.1, 0.12, 0.14),
    ),
    "strategies": Experiment(
        "vla_in_sd: 35 tasks, targets that stand still (level 0) and that move (level 1)",
        "all 35 tasks at level 0 (S) or at level 1 (D)",
        (
            PaperRow("ACT, S", 27.74, 27.74, 0),
            PaperRow("OpenVLA-OFT, S", 17.51, 17.51, 0),
            PaperRow("pi0.5, S", 44.83, 44.83, 0),
            PaperRow("ACT, D", 13.97, 13.97, 0),
            PaperRow("OpenVLA-OFT, D", 14.09, 14.67, 0),
            PaperRow("pi0.5, D", 22.54, 22.54, 0),
            PaperRow("ACT, S", 6.54, 26.74),
            PaperRow("OpenVLA-OFT, S", 6.71, 20.02),
            PaperRow("pi0.5, S", 7.46, 20.44),
            PaperRow("ACT, D", 9.43, 24.97),
            PaperRow("OpenVLA-OFT, D", 9.06, 24.06),
            PaperRow("pi0.5, D", 9.63, 26.12),
        ),
    ),
    "mixture": Experiment(
        "exp_mix: 35 tasks, level 1",
        "all 35 tasks at level 1 (D), or at levels 0 and 1 (S + D)",
        (
            PaperRow("OpenVLA-OFT (Qwen3-VL), D", 10.86, 30.49),
            PaperRow("OpenVLA-OFT (Qwen3-VL), S + D", 12.89, 30.80),
            PaperRow("PUMA with N = 2, D", 14.80, 32.74),
            PaperRow("PUMA with N = 2, S + D", 19.71, 37.76),
        ),
    ),
    "oracle": Experiment(
        "exp_oracle: 35 tasks, level 1",
        "all 35 tasks at level 1",
        (
            PaperRow("OpenVLA-OFT", 9.06, 24.06),
            PaperRow("OpenVLA-OFT, told the target's future", 10.33, 32.00),
        ),
    ),
    "ablation": Experiment(
        "ablation_unified: 35 tasks, level 1",
        "all 35 tasks at level 1",
        (
            PaperRow("baseline", 10.86, 30.49),
            PaperRow("+ flow", 11.71, 31.02),
            PaperRow("+ flow, N = 2", 14.80, 32.74),
            PaperRow("+ frames, N = 2", 8.15, 28.62),
            PaperRow("+ flow, N = 4", 17.20, 34.97),
        ),
    ),
    "history-length": Experiment(
        "history_length: 35 tasks, level 1",
        "all 35 tasks at level 1",
        (PaperRow("h = 1", 13.00, 30.97), PaperRow("h = 4", 17.20, 34.97)),
    ),
    "horizon": Experiment(
        "horizon_ext: 35 tasks, level 1",
        "all 35 tasks at level 1",
        (
            PaperRow("no prediction", 10.86, 30.49),
            PaperRow("N = 2", 14.80, 32.74),
            PaperRow("N = 4", 17.20, 34.97),
            PaperRow("N = 6", 13.62, 32.99),
        ),
    ),
    "double": Experiment(
        "data_scale: ten tasks, level 1",
        "the ten tasks at level 1, twice the demonstrations",
        (PaperRow("pi0.5", 15.6, 30.8), PaperRow("PUMA", 27.4, 43.9)),
        TEN,
    ),
}


def experiment(name: str) -> Experiment:
    """An experiment by name. Raises PaperError with the names there are."""
    if name not in EXPERIMENTS:
        raise PaperError(f"{name!r} is no experiment of the paper: choose {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]


def beside(found: Experiment, means: Sequence[Row]) -> list[Row]:
    """The rows of the paper, each group (level and category) after that of `means`, which are those
    of summary.py."""
    out = list[Row]()
    for level, category in dict.fromkeys((row.level, row.category) for row in found.rows):
        head = {"level": level, "category": category}
        ours = (m for m in means if (m["level"], m["category"]) == (level, category))
        keys = (
            "success_rate",
            "success_rate_interval",
            "manipulation_score",
            "manipulation_score_interval",
        )
        out += [
            head | {"method": m["policy"], "paper": False} | {key: m[key] for key in keys}
            for m in ours
        ]
        for row in found.rows:
            if (row.level, row.category) == (level, category):
                values = {
                    "success_rate": row.success_rate,
                    "manipulation_score": row.manipulation_score,
                }
                out.append(head | {"method": row.method, "paper": True} | values)
    return out


def differences(found: Experiment, episodes: int, rules: str, clock: str) -> list[str]:
    """What sets our rows apart from the paper's."""
    out = [
        "scenes, objects and robot models are ours, and so is the simulation",
        (
            f"the paper's policies learned from {found.trained} of the paper's data; yours as you"
            " trained it"
        ),
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
