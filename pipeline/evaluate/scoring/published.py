"""What others report on DOMINO: cited beside our numbers, never mixed with them. Their robots,
objects and protocol are others."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """Per cent over the 35 tasks at level 1, as the authors state them; None if they do not."""

    model: str
    success_rate: float | None
    manipulation_score: float | None
    source: str


PUBLISHED = (
    Published("ACT, trained per task on level 0", 6.5, None, "the DOMINO paper"),
    Published("ACT, trained per task on level 1", 9.4, None, "the DOMINO paper"),
    Published("PUMA", 17.2, None, "the DOMINO paper"),
    Published("Qwen-VLA, zero-shot", 26.6, None, "its authors"),
    Published("InternVLA-A1.5, zero-shot", 27.7, 39.8, "its authors"),
    Published("InternVLA-A1.5", 29.3, 42.5, "its authors"),
    Published("DynamicWAM without flow and motion", 22.7, None, "its authors"),
    Published("DynamicWAM", 38.2, 53.2, "its authors"),
)
