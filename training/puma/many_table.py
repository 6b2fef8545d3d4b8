"""What was evaluated in a run of `puma many`: its rows and tables."""

from collections import defaultdict
from itertools import product
from typing import Any

from pipeline.evaluate.scoring.results import EPISODES, Results, check_episode
from pipeline.evaluate.scoring.statistics import SceneResult, clustered, paired_numbers
from training.puma.many import CONDITIONS, UNSEEN, Many

Row = dict[str, Any]


def results(many: Many) -> list[Row]:
    """What has been evaluated: a row an episode, with the network's name, condition, task, level,
    seed of the scene, success, and whether the target was met."""
    found = list[Row]()
    for learner, condition, task in product(many.learners, CONDITIONS, many.tasks):
        path = many.evaluation(learner, condition) / task / EPISODES
        found += [
            {"network": learner.name, "condition": condition, "task": task}
            | {name: row[name] for name in ("level", "seed", "success")}
            | {"met": row.get("meeting") is not None}
            for row in (Results(path, check_episode).rows() if path.exists() else ())
        ]
    return found


def table(many: Many) -> str:
    """Success rates by condition, task and level, then of all tasks, networks together, with 95 %
    intervals that are clustered by scene."""
    cells = defaultdict[tuple[str, str, int], list[Row]](list)
    found = [row for row in results(many) if row["network"] not in many.twins]
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


def twins(many: Many) -> str:
    """Every twin beside the first network on the scenes that both tried, by level: success in the
    mean of tasks, and the difference in points with its 95 % interval over scenes."""
    tried = defaultdict[str, dict[tuple[str, int, int], float]](dict)
    for row in results(many):
        if row["condition"] == UNSEEN:
            scene = (row["task"], row["level"], row["seed"])
            tried[row["network"]][scene] = float(row["success"])
    lines = [
        "| twin | level | scenes | network 0, % | twin, % | difference, points (95 %) |",
        "|---|---:|---:|---:|---:|---|",
    ]
    first = tried[many.learners[0].name]
    for name, level in product(many.twins, many.levels):
        scenes = [
            SceneResult(key[0], first[key], other, int(other > first[key]), int(other < first[key]))
            for key, other in tried[name].items()
            if key in first and key[1] == level
        ]
        if scenes:
            found = paired_numbers(scenes, 0.1)
            rates = "{first_rate:.0f} | {second_rate:.0f} | {effect:+.1f}".format(**found)
            low, high = found["interval"]
            lines.append(
                f"| {name} | {level} | {len(scenes)} | {rates} ({low:+.0f} to {high:+.0f}) |"
            )
    return "\n".join(lines)
