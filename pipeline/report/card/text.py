"""Writes an export's card."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.dataset import Dataset, licences_in
from pipeline.data.slots.select import TEST, VALIDATION, split_of
from pipeline.html import bullets, code_block, code_span, markdown, table
from pipeline.motion.models import PLANAR, level_name, level_of
from pipeline.motion.planar_shapes import mean_speed
from pipeline.report.film_strip import clip, contact_sheet, encode

from .loading import loading_section
from .plots import plots
from .survey import SurveyedEpisode, by_cell, camera_names, cameras, look, visibility
from .words import citation, is_failures, kind_of, limits, title, uses

SHEET_ROWS, CLIPS, CELLS = 8, 4, 40
IN_FORCE = "is the joint target in force at frame t"
TIMING = {
    "robotwin": f"`joint_action[t]` {IN_FORCE}, `joint_action[t + 1]` the next one.",
    "xpolicylab": f"`state[t]` {IN_FORCE}, `action[t]` the next one.",
}
TIMING["dynamicwam"] = TIMING["robotwin"]
"""When states and actions hold, in formats that are not as the others."""


def describe(dataset: Path, episodes: Sequence[Path]) -> Callable[[Path, Mapping[str, Any]], str]:
    """What makes the card of an export of these episodes from its directory and summary."""

    def write(folder: Path, summary: Mapping[str, Any]) -> str:
        seen = [look(path) for path in episodes]
        images = folder / "card"
        images.mkdir(exist_ok=True)
        (images / "plots.png").write_bytes(plots(seen))
        chosen = [cell[0].file for cell in by_cell(seen).values()]
        sheet = contact_sheet(spread(chosen, SHEET_ROWS))
        (images / "contact_sheet.jpg").write_bytes(encode(sheet))
        films = list[str]()
        for number, path in enumerate(spread(chosen, CLIPS)):
            name = f"clip_{number}.mp4"
            (images / name).write_bytes(clip(path))
            films.append(f'<video src="card/{name}" controls muted loop width="420"></video>')
        intended, unintended = map(bullets, uses(seen, summary))
        held = _reasons(seen) if is_failures(summary) else ""
        shown = visibility(seen, camera_names(seen, summary))
        sections = {
            "Intended use": f"For:\n\n{intended}\nNot for:\n\n{unintended}",
            "What is in it": held + _cells(dataset, seen) + _speeds(seen),
            "How it looks": "\n".join(["![one row an episode](card/contact_sheet.jpg)", *films]),
            "Plots": "![starts, motions, speeds, lengths, ranges](card/plots.png)",
            "Cameras": cameras(seen, summary) + shown,
            "How to load it": loading_section(folder, summary),
            "Splits": _splits(seen, summary.get("validation", VALIDATION)),
            "How it was made": _origin(dataset, summary),
            "Known limits": bullets(limits(seen, summary)),
            "Citation": f"```bibtex\n{citation(seen, summary)}```\n",
        }
        texts = (f"## {head}\n\n{text.strip()}\n" for head, text in sections.items())
        return "\n".join([f"# {title(seen, summary)}\n\n{_opening(seen, summary)}\n", *texts])

    return write


def spread(items: Sequence[Path], count: int) -> list[Path]:
    """At most `count` of them, evenly spread, the first and the last among them."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count)]


def _opening(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    hours, frames = sum(one.seconds for one in seen) / 3600, sum(one.frames for one in seen)
    size = f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.1f} min"
    levels = ", ".join(
        markdown(f"{level_name(*level)} ({level_of(*level).text})")
        for level in sorted({one.level for one in seen})
    )
    what = "robots manipulate objects that move"
    if is_failures(summary):
        what = "a scripted expert did not meet its task's conditions on an object that moves"
    elif policy := seen[0].meta.corrects:
        what = f"the policy {code_span(policy)} acts on objects that move; a scripted expert"
        what += " labels every frame, takes over and finishes"
    action = "the joint target commanded for the interval after it"
    timing = f"`state` is measured at a frame, `action` is {summary.get('action', action)}."
    return (
        f"{len(seen)} {kind_of(summary)}, {frames} frames at {seen[0].meta.fps} Hz, {size}: {what}."
        f" Levels of motion: {levels}. Format: {code_span(summary['format'])}."
        f" {TIMING.get(summary['format'], timing)} Poses are x y z qw qx qy qz in the world frame"
        " (m): x to the robot's right, y away from it, z up, table top at z = 0.74."
    )


def _reasons(seen: Sequence[SurveyedEpisode]) -> str:
    failures = (one.meta.failure for one in seen)
    counts = Counter((failure.stage, failure.reason) for failure in failures if failure)
    rising = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return table("stage | reason | attempts", [[*why, count] for why, count in rising])


def _cells(dataset: Path, seen: Sequence[SurveyedEpisode]) -> str:
    attempts, rows = dict[tuple[Any, ...], list[bool]](), list[list[object]]()
    names = ("task", "embodiment", "level", "alpha", "domain")
    for row in Dataset(dataset).attempt_rows(*names, "outcome"):
        key = tuple(row[name] for name in names)
        attempts.setdefault(key, []).append(row["outcome"] == "accepted")
    for cell, mine in by_cell(seen).items():
        task, robot, level, alpha, domain = (getattr(cell, name) for name in names)
        tried = attempts.get((task, robot, level, alpha, domain), [])
        share = f"{100 * sum(tried) / len(tried):.0f} % of {len(tried)}" if tried else ""
        lengths = [one.seconds for one in mine]
        length = f"{np.mean(lengths):.1f} ({min(lengths):.1f} to {max(lengths):.1f})"
        rows.append([task, robot, level, f"{alpha:g}", domain, len(mine), share, length])
    text = table(
        "task | robot | level | alpha (m/s) | domain | episodes | attempts accepted | length (s)",
        rows,
    )
    if len(rows) > CELLS:
        text = f"<details><summary>{len(rows)} cells</summary>\n\n{text}</details>\n\n"
    return text


def _speeds(seen: Sequence[SurveyedEpisode]) -> str:
    rows = []
    for level, alpha in sorted({(one.level, one.spec.alpha) for one in seen}):
        mine = [one for one in seen if (one.level, one.spec.alpha) == (level, alpha)]
        average = [one.meta.average_speed for one in mine]
        most = max(one.meta.maximum_speed for one in mine)
        asked = f"{mean_speed(alpha):.3f}" if level == (PLANAR, 1) and alpha else ""
        speeds = [f"{speed:.3f}" for speed in (np.mean(average), max(average), most)]
        moved = f"{np.mean([one.meta.displacement for one in mine]):.2f}"
        late = sum(one.start > 0 for one in mine)
        rows.append([level_name(*level), f"{alpha:g}", len(mine), asked, *speeds, moved, late])
    return table(
        "level | alpha (m/s) | episodes | asked of the law, mean (m/s) | average speed, mean (m/s)"
        " | average speed, most | greatest speed (m/s) | from start to meeting (m) |"
        " started after the robot",
        rows,
    )


def _splits(seen: Sequence[SurveyedEpisode], validation: float) -> str:
    counts = Counter(
        split_of(one.spec.pair or one.meta.physics_id or one.spec.to_json(), validation)
        for one in seen
    )
    shares = {"train": 1 - validation - TEST, "validation": validation, "test": TEST}
    return (
        "The column `split` of the table of episodes, chosen by a hash of `physics_id`: the same"
        " in every format and rendering, all looks of one motion in one split. `load_dataset(...,"
        " split='train')` and `splits` in LeRobot's `meta/info.json` cover all episodes: select by"
        " the column. Seen and unseen sentences have templates and descriptions of their own. To"
        " hold out textures, split by domain.\n\n"
    ) + table(
        "split | episodes | share on average (%)",
        [[split, counts[split], f"{100 * share:g}"] for split, share in shares.items()],
    )


def _origin(dataset: Path, summary: Mapping[str, Any]) -> str:
    place = Dataset(dataset)
    made, keys = place.made_by(), ("renderer", "processor", "python", "code_version")
    rows = {key: made[key] for key in keys if key in made} | made.get("packages", {})
    rows |= {f"licence of {name}": licence for name, licence in licences_in(made).items()}
    text = (
        "Physics at 240 Hz. An attempt is a dry run, the back-calculation of the target's motion,"
        " and a rollout in which it moves, judged from its state log."
    )
    text += " These failed in one of them.\n\n" if is_failures(summary) else "\n\n"
    text += table("made with | ", rows.items()) if rows else ""
    recipe = place.manifest.read_text().strip() if place.manifest.exists() else ""
    return text + (f"The recipe:\n\n{code_block(recipe, 'yaml')}" if recipe else "")
