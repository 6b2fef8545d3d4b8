"""Fills the templates of a card with what an export holds."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.dataset import Dataset, licences_in
from pipeline.data.recipe.cells import Cell
from pipeline.data.slots.select import TEST, VALIDATION, split_of
from pipeline.html import bullets, code_block, code_span, markdown, render_page, table
from pipeline.motion.models import PLANAR, level_name, level_of
from pipeline.motion.planar_shapes import mean_speed
from pipeline.motion.recorded import LEAST, SECONDS
from pipeline.report.film_strip import clip, contact_sheet, encode

from .plots import plots
from .survey import SurveyedEpisode, by_cell, camera_names, cameras, look, visibility

SHEET_ROWS, CLIPS, CELLS = 8, 4, 40
IN_FORCE = "is the joint target in force at frame t"
TIMING = {
    "robotwin": f"`joint_action[t]` {IN_FORCE}, `joint_action[t + 1]` the next one.",
    "xpolicylab": f"`state[t]` {IN_FORCE}, `action[t]` the next one.",
}
TIMING["dynamicwam"] = TIMING["robotwin"]
"""When states and actions hold, in formats that are not as the others."""

EXPERTS = {
    "planned": "that know the target's motion in advance",
    "reactive": "that see the target's poses up to each moment, and know nothing of its future but"
    " which arm is to act",
}


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
        films = [f"clip_{number}.mp4" for number in range(min(CLIPS, len(chosen)))]
        for name, path in zip(films, spread(chosen, CLIPS), strict=True):
            (images / name).write_bytes(clip(path))
        failures = summary.get("split") == "failures"
        held = _reasons(seen) if failures else ""
        values = {
            **_opening(seen, summary, failures),
            **_parts(folder),
            "contents": held + _cells(dataset, seen) + _speeds(seen),
            "films": films,
            "cameras": cameras(seen, summary),
            "visibility": visibility(seen, camera_names(seen, summary)),
            "splits": _splits(seen, summary.get("validation", VALIDATION)),
            **_origin(dataset),
        }
        plain = {name: v.strip() if isinstance(v, str) else v for name, v in values.items()}
        return render_page("pipeline.report.card", "card.md.jinja", **plain) + "\n"

    return write


def spread(items: Sequence[Path], count: int) -> list[Path]:
    """At most `count` of them, evenly spread, the first and the last among them."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count)]


def _opening(
    seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any], failures: bool
) -> dict[str, Any]:
    """What title, first lines, limits and citation say. The identifier is from the sorted physics
    ids: equal for every format and rendering.
    """
    tasks, robots = (sorted({getattr(e.spec, k) for e in seen}) for k in ("task", "embodiment"))
    about = tasks[0].replace("_", " ") if len(tasks) == 1 else f"{len(tasks)} tasks"
    hours = sum(one.seconds for one in seen) / 3600
    what = "robots manipulate objects that move"
    if failures:
        what = "a scripted expert did not meet its task's conditions on an object that moves"
    elif policy := seen[0].meta.corrects:
        what = f"the policy {code_span(policy)} acts on objects that move; a scripted expert"
        what += " labels every frame, takes over and finishes"
    action = "the joint target commanded for the interval after it"
    timing = f"`state` is measured at a frame, `action` is {summary.get('action', action)}."
    # a policy is corrected by the reactive expert
    experts = {"reactive" if one.meta.corrects else one.meta.expert for one in seen}
    ids = sorted({one.meta.physics_id or one.spec.to_json() for one in seen})
    levels = sorted({one.level for one in seen})
    return {
        "title": f"Dynamic manipulation{', failed attempts' if failures else ''}: {about},"
        f" {', '.join(robots)}",
        "count": len(seen),
        "kind": "failed attempts" if failures else "simulated episodes",
        "frames": sum(one.frames for one in seen),
        "fps": seen[0].meta.fps,
        "length": f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.1f} min",
        "what": what,
        "levels": ", ".join(
            markdown(f"{level_name(*level)} ({level_of(*level).text})") for level in levels
        ),
        "format": summary["format"],
        "format_span": code_span(summary["format"]),
        "timing": TIMING.get(summary["format"], timing),
        "failures": failures,
        "corrected": any(one.meta.corrects for one in seen),
        "experts": ", or ".join(EXPERTS[name] for name in sorted(experts)),
        "identifier": sha256("\n".join(ids).encode()).hexdigest()[:16],
        "least": f"{100 * LEAST:.0f}",
        "seconds": f"{SECONDS:g}",
    }


def _parts(folder: Path) -> dict[str, Any]:
    """The LeRobot datasets of an export that holds several, which differ in vector width."""
    infos = (path.relative_to(folder) for path in folder.rglob("meta/info.json"))
    parts = sorted(path.parent.parent.as_posix() for path in infos if len(path.parts) > 2)
    return {"parts": parts, "parts_list": bullets(map(code_span, parts))}


def _reasons(seen: Sequence[SurveyedEpisode]) -> str:
    failures = (one.meta.failure for one in seen)
    counts = Counter((failure.stage, failure.reason) for failure in failures if failure)
    rising = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return table("stage | reason | attempts", [[*why, count] for why, count in rising])


def _cells(dataset: Path, seen: Sequence[SurveyedEpisode]) -> str:
    attempts, rows = dict[tuple[Any, ...], list[bool]](), list[list[object]]()
    names = Cell.__match_args__
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
    return table(
        "split | episodes | share on average (%)",
        [[split, counts[split], f"{100 * share:g}"] for split, share in shares.items()],
    )


def _origin(dataset: Path) -> dict[str, str]:
    place = Dataset(dataset)
    made, keys = place.made_by(), ("renderer", "processor", "python", "code_version")
    rows = {key: made[key] for key in keys if key in made} | made.get("packages", {})
    rows |= {f"licence of {name}": licence for name, licence in licences_in(made).items()}
    recipe = place.manifest.read_text().strip() if place.manifest.exists() else ""
    return {
        "made": table("made with | ", rows.items()) if rows else "",
        "recipe": code_block(recipe, "yaml") if recipe else "",
    }
