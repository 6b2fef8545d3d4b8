"""The page of an evaluation: one HTML file with its tables, its films, and published results."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.evaluate.scoring.plot import panels
from pipeline.evaluate.scoring.summary import Row
from pipeline.html import render_page

type Film = tuple[str, bytes, bytes]
"""The caption of an episode, a strip (JPEG bytes) and a film (mp4 bytes, b"" without)."""


def page(
    cells: Sequence[Row],
    means: Sequence[Row],
    films: Sequence[Film] = (),
    code: str = "",
    benchmark: str = "",
) -> str:
    """The page's text. `cells` and `means` are those of summary.py; `code` is the version of the
    program, `benchmark` the label of what all were tried on."""
    version = f"Code {code[:12]}." if code else ""
    version += f" Benchmark {benchmark}." if benchmark else ""
    episodes = sum(cell["episodes"] for cell in cells)
    values = {"cells": cells, "means": means, "panels": panels(means), "films": films}
    values |= {"published": PUBLISHED, "episodes": episodes, "code": version}
    return render_page("pipeline.evaluate", "evaluation.html", **values)


def caption(row: Row) -> str:
    """The caption of a film."""
    outcome = "success" if row["success"] else f"{row['failure']} ({', '.join(row['failed'])})"
    where = f"{row['task']}, level {row['level']}, alpha {row['alpha']:g}, {row['domain']}"
    where += f", seed {row['seed']}"
    truth = " (sees the truth)" if row["sees_truth"] else ""
    return f"{row['policy']}{truth}: {where}: {outcome}, MS {row['manipulation_score']:.0f}"


@dataclass(frozen=True)
class Published:
    """Per cent over the 35 tasks at level 1, as the authors state them."""

    model: str
    success_rate: float | None
    manipulation_score: float | None
    source: str


PUBLISHED = (
    Published("ACT, trained per task on level 0", 6.5, None, "the DOMINO paper"),
    Published("ACT, trained per task on level 1", 9.4, None, "the DOMINO paper"),
    Published("pi0.5", 9.6, 26.2, "the DOMINO paper"),
    Published("OpenVLA-OFT (Qwen3-VL)", 10.9, 30.5, "the DOMINO paper"),
    Published("PUMA", 17.2, 35.0, "the DOMINO paper"),
    Published("VLAct", 18.5, 34.2, "its authors"),
    Published("Fast-WAM", 19.9, 33.3, "its authors"),
    Published("Qwen-VLA, zero-shot", 26.6, None, "its authors"),
    Published("InternVLA-A1.5, zero-shot", 27.7, 39.8, "its authors"),
    Published("InternVLA-A1.5", 29.3, 42.5, "its authors"),
    Published("D2-VLA", 29.3, 40.6, "arXiv:2609.34792"),
    Published("DynamicWAM without flow and motion", 22.7, None, "its authors"),
    Published("DynamicWAM", 32.9, None, "one of its users"),
    Published("Long-WAM", 34.9, 45.1, "arXiv:2610.10528"),
    Published("DynamicWAM", 38.2, 53.2, "its authors"),
)
