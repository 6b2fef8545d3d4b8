"""Writes the card of an export: Markdown, and its images in card/."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.dataset import Dataset, licences_in
from pipeline.data.slots.select import TEST, VALIDATION, split_of
from pipeline.html import Markdown, code_block, code_span, markdown
from pipeline.motion.models import PLANAR, level_name, level_of
from pipeline.motion.planar_shapes import mean_speed
from pipeline.report.card.frames import camera_names, cameras, idle, out_of_view, visibility
from pipeline.report.card.loading import loading_section
from pipeline.report.card.markdown import bullets, table
from pipeline.report.card.plots import plots
from pipeline.report.card.survey import SurveyedEpisode, by_cell, look
from pipeline.report.card.words import citation, is_failures, kind_of, limits, title, uses
from pipeline.report.contact_sheet import save_contact_sheet
from pipeline.report.film_strip import clip

SHEET_ROWS, CLIPS, CELLS = 8, 4, 40


def describe(dataset: Path, episodes: Sequence[Path]) -> Callable[[Path, Mapping[str, Any]], str]:
    """A function of an export's directory and summary that gives the text of its card, for these
    episodes."""

    def write(folder: Path, summary: Mapping[str, Any]) -> str:
        seen = [look(path) for path in episodes]
        images = folder / "card"
        images.mkdir(exist_ok=True)
        (images / "plots.png").write_bytes(plots(seen))
        chosen = [cell[0].file for cell in by_cell(seen).values()]
        save_contact_sheet(images / "contact_sheet.jpg", spread(chosen, SHEET_ROWS))
        films = []
        for number, path in enumerate(spread(chosen, CLIPS)):
            (images / f"clip_{number}.mp4").write_bytes(clip(path))
            films.append(
                f'<video src="card/clip_{number}.mp4" controls muted loop width="420"></video>'
            )
        sections = {
            "": _opening(seen, summary),
            "Intended use": _use(seen, summary),
            "What is in it": (
                (_reasons(seen) if is_failures(summary) else "")
                + _cells(dataset, seen)
                + _speeds(seen)
                + idle(seen)
            ),
            "How it looks": "\n".join(
                ["![one row an episode](card/contact_sheet.jpg)", "", *films]
            ),
            "Plots": "![starts, motions, speeds, lengths, ranges](card/plots.png)",
            "Cameras and joints": (
                cameras(seen, summary)
                + visibility(seen, camera_names(seen, summary))
                + out_of_view(seen, summary)
                + _joints(seen)
            ),
            "How to load it": loading_section(folder, summary),
            "Splits": _splits(seen, summary.get("validation", VALIDATION)),
            "How it was made": _describe_origin(dataset, summary),
            "Known limits": bullets(limits(seen, summary)),
            "Citation": f"```bibtex\n{citation(seen, summary)}```\n",
        }
        return "\n".join(
            f"{'## ' + head if head else '# ' + title(seen, summary)}\n\n{text.strip()}\n"
            for head, text in sections.items()
        )

    return write


def spread(items: Sequence[Path], count: int) -> list[Path]:
    """At most `count` of them, evenly spread, the first and the last among them."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count)]


def _opening(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    hours = sum(one.seconds for one in seen) / 3600
    levels = ", ".join(
        markdown(f"{level_name(*level)} ({level_of(*level).text})")
        for level in sorted({one.level for one in seen})
    )
    size = f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.1f} min"
    began = (
        f"{len(seen)} {kind_of(summary)}, {sum(one.frames for one in seen)} frames at"
        f" {seen[0].meta.fps} Hz, {size}"
    )
    what = (
        "a scripted expert tried to handle an object that moves, and did not meet its task's"
        " conditions"
    )
    if not is_failures(summary):
        what = "robots manipulate objects that move"
        if policy := seen[0].meta.corrects:
            what = f"the policy {code_span(policy)} acts on objects that move; "
            what += "a scripted expert labels every frame, takes over and finishes"
    return (
        f"{began}: {what}. Levels of motion: {levels}. Format: {code_span(summary['format'])}."
        f" {_timing(summary)} Poses are x y z qw qx qy qz in the world frame (m): x to"
        " the robot's right, y away from it, z up, table top at z = 0.74."
    )


def _timing(summary: Mapping[str, Any]) -> str:
    """When states and actions of an export hold."""
    format = summary["format"]
    if action := summary.get("action"):
        return f"`state` is measured at a frame. `action`: {action}."
    if format in ("robotwin", "dynamicwam"):
        return (
            "`joint_action[t]` is the joint target in force at frame t, `joint_action[t + 1]` that"
            " of the interval after it."
        )
    if format == "xpolicylab":
        return (
            "`state` is the joint target in force at a frame, `action` that of the interval"
            " after it."
        )
    return (
        "`state` is measured at a frame, `action` is the joint target commanded for the interval"
        " after it; nothing is shifted."
    )


def _use(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    intended, unintended = uses(seen, summary)
    return f"For:\n\n{bullets(intended)}\nNot for:\n\n{bullets(unintended)}"


def _reasons(seen: Sequence[SurveyedEpisode]) -> str:
    """Why the attempts failed, the most frequent reason first."""
    told = Counter(
        (one.meta.failure.stage, one.meta.failure.reason) for one in seen if one.meta.failure
    )
    rows = [
        [stage, reason, count]
        for (stage, reason), count in sorted(told.items(), key=lambda item: (-item[1], item[0]))
    ]
    return table("stage | reason | attempts", rows)


def _cells(dataset: Path, seen: Sequence[SurveyedEpisode]) -> str:
    attempts: dict[tuple[Any, ...], list[bool]] = {}
    of_cell = ("task", "embodiment", "level", "alpha", "domain")
    for row in Dataset(dataset).attempt_rows(*of_cell, "outcome"):
        key = tuple(row[name] for name in of_cell)
        attempts.setdefault(key, []).append(row["outcome"] == "accepted")
    rows = []
    for cell, mine in by_cell(seen).items():
        tried = attempts.get((cell.task, cell.embodiment, cell.level, cell.alpha, cell.domain), [])
        lengths = [one.seconds for one in mine]
        share = f"{100 * sum(tried) / len(tried):.0f} % of {len(tried)}" if tried else ""
        length = f"{np.mean(lengths):.1f} ({min(lengths):.1f} to {max(lengths):.1f})"
        rows.append(
            [
                cell.task,
                cell.embodiment,
                cell.level,
                f"{cell.alpha:g}",
                cell.domain,
                len(mine),
                share,
                length,
            ]
        )
    head = "task | robot | level | alpha (m/s) | domain | episodes | attempts accepted | length (s)"
    text = table(head, rows)
    return (
        text
        if len(rows) <= CELLS
        else f"<details><summary>{len(rows)} cells</summary>\n\n{text}</details>\n\n"
    )


def _speeds(seen: Sequence[SurveyedEpisode]) -> str:
    rows = []
    for (model, level), alpha in sorted({(one.level, one.spec.alpha) for one in seen}):
        group = [one for one in seen if (one.level, one.spec.alpha) == ((model, level), alpha)]
        mine = [one.meta for one in group]
        average, most = [m.average_speed for m in mine], [m.maximum_speed for m in mine]
        moved, late = [m.displacement for m in mine], sum(one.start > 0 for one in group)
        rows.append(
            [
                level_name(model, level),
                f"{alpha:g}",
                len(mine),
                f"{mean_speed(alpha):.3f}" if (model, level) == (PLANAR, 1) and alpha else "",
                *(f"{speed:.3f}" for speed in (np.mean(average), max(average), max(most))),
                f"{np.mean(moved):.2f}",
                late,
            ]
        )
    return table(
        "level | alpha (m/s) | episodes | asked of the law, mean (m/s) | average speed, mean (m/s)"
        " | average speed, most | greatest speed (m/s) | from start to meeting (m) |"
        " started after the robot",
        rows,
    )


def _joints(seen: Sequence[SurveyedEpisode]) -> str:
    robots = {one.spec.embodiment: one.names for one in seen}
    rows = []
    for robot, names in sorted(robots.items()):
        for number, name in enumerate(names):
            unit = "0 closed, 1 open" if name.endswith("gripper") else "rad"
            rows.append([robot, number, code_span(name), unit])
    return table("robot | index | joint | unit", rows)


def _splits(seen: Sequence[SurveyedEpisode], validation: float) -> str:
    def count(values: Iterable[object]) -> int:
        return len({repr(value) for value in values})

    seen_sentences, unseen = (
        {text for one in seen for text in one.instructions[i]} for i in (0, 1)
    )
    rows = [
        [
            Markdown("physics (`physics_id`)"),
            count(one.meta.physics_id or one.file for one in seen),
        ],
        ["motions of the target", count(one.path.tolist() for one in seen)],
        ["target objects", count(one.meta.objects[one.meta.target] for one in seen)],
        ["looks (room, lights, textures)", count(one.meta.drawing.visuals for one in seen)],
        ["sentences, seen", len(seen_sentences)],
        ["sentences, unseen", len(unseen)],
        ["sentences in both", len(seen_sentences & unseen)],
    ]
    counts = Counter(
        split_of(one.spec.pair or one.meta.physics_id or one.spec.to_json(), validation)
        for one in seen
    )
    shares = [[split, counts[split]] for split in ("train", "validation", "test")]
    percent = ", ".join(f"{100 * share:g}" for share in (1 - validation - TEST, validation))
    return (
        f"The column `split` of the table of episodes is `train`, `validation` or `test` ({percent}"
        " and 10 % of the physics episodes on average), chosen by a hash of `physics_id`: the same"
        " in every format and rendering, all looks of one motion in one split. `load_dataset(...,"
        " split='train')` and `splits` in LeRobot's `meta/info.json` cover all episodes, because"
        " they can name only ranges of rows: select by the column. Seen and unseen sentences have"
        " templates and descriptions of their own. To hold out textures, split by domain.\n\n"
        + table("split | episodes", shares)
        + table("distinct | number", rows)
    )


def _describe_origin(dataset: Path, summary: Mapping[str, Any]) -> str:
    place = Dataset(dataset)
    made = place.made_by()
    rows = [
        [key, made[key]]
        for key in ("renderer", "processor", "python", "code_version")
        if key in made
    ]
    rows += [[name, version] for name, version in made.get("packages", {}).items()]
    rows += [[f"licence of {name}", licence] for name, licence in licences_in(made).items()]
    recipe = place.manifest.read_text().strip() if place.manifest.exists() else ""
    stages = (
        "a dry run, the back-calculation of the target's motion, and a rollout in which it moves"
    )
    origin = f"every episode went through {stages}, whose success was judged from its state log"
    if is_failures(summary):
        origin = f"an attempt goes through {stages}; these failed in one of them"
    text = f"Physics at 240 Hz; {origin}.\n\n"
    text += table("made with | ", rows) if rows else ""
    return text + (f"The recipe:\n\n{code_block(recipe, 'yaml')}" if recipe else "")
