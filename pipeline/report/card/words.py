"""A card's intended use, limits and citation."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

from .survey import SurveyedEpisode

FAILURES = "failures"
PAPER = "https://arxiv.org/abs/2603.15620"

USES = (
    "Training policies that handle moving objects.",
    "Comparing policies and prediction of motion across levels, speeds, robots and looks.",
)
USES_OF_FAILURES = (
    "Training detectors of failure, success classifiers and value functions.",
    "Studying where the scripted experts fail.",
)
NOT_FOR = (
    "Running a policy on a real robot without further validation and safety measures.",
    "Conclusions about people: the data contain none.",
)
NOT_DEMONSTRATIONS = "Imitation: these attempts are not demonstrations."
SIMULATED = (
    "Everything is simulated (SAPIEN 3, rigid bodies). Objects are generated from parameters; they"
    " are not scans of products."
)
UNBLURRED = "Images are drawn without sensor noise, motion blur or rolling shutter."
EXPERTS = {
    "planned": "that know the target's motion in advance",
    "reactive": "that see the target's poses up to each moment, and know nothing of its future but"
    " which arm is to act",
}
CORRECTED = (
    "A policy acts first in every episode. `intervention` is false (0) until the expert takes over,"
    " also while `perturb` holds or pushes the robot. `expert_action` is the expert's action at"
    " every frame."
)
NOT_POLICY = "Imitating `action` where `intervention` is false: it is not the expert's."
LIMITS = (
    SIMULATED,
    "Demonstrations come from scripted experts {knowing}. Failed attempts are left out, so motions"
    " that the experts cannot meet are rarer than they were drawn.",
    UNBLURRED,
)
LIMITS_OF_FAILURES = (
    SIMULATED,
    "Only as many failed attempts are stored as the recipe sets (`keep_failures`), so their"
    " shares are not rates of failure.",
    "In an attempt that failed in the dry run the target stands still.",
    UNBLURRED,
)


def is_failures(summary: Mapping[str, Any]) -> bool:
    return summary.get("split") == FAILURES


def kind_of(summary: Mapping[str, Any]) -> str:
    return "failed attempts" if is_failures(summary) else "simulated episodes"


def uses(
    seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]
) -> tuple[Sequence[str], Sequence[str]]:
    if is_failures(summary):
        return USES_OF_FAILURES, (NOT_DEMONSTRATIONS, *NOT_FOR)
    return USES, (NOT_POLICY, *NOT_FOR) if _corrected(seen) else NOT_FOR


def limits(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> Sequence[str]:
    if is_failures(summary):
        return LIMITS_OF_FAILURES
    # a policy is corrected by the reactive expert
    experts = {"reactive" if one.meta.corrects else one.meta.expert for one in seen}
    knowing = ", or ".join(EXPERTS[name] for name in sorted(experts))
    texts = [text.format(knowing=knowing) for text in LIMITS]
    return [CORRECTED, *texts] if _corrected(seen) else texts


def _corrected(seen: Sequence[SurveyedEpisode]) -> bool:
    return any(one.meta.corrects for one in seen)


def title(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    tasks = sorted({one.spec.task for one in seen})
    what = tasks[0].replace("_", " ") if len(tasks) == 1 else f"{len(tasks)} tasks"
    kind = ", failed attempts" if is_failures(summary) else ""
    robots = ", ".join(sorted({one.spec.embodiment for one in seen}))
    return f"Dynamic manipulation{kind}: {what}, {robots}"


def citation(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    """BibTeX of the dataset and of the paper. The identifier is from the sorted physics ids:
    equal for every format and rendering.
    """
    ids = sorted({one.meta.physics_id or one.spec.to_json() for one in seen})
    name = sha256("\n".join(ids).encode()).hexdigest()[:16]
    return f"""\
@misc{{domino_data_{name},
  title = {{{title(seen, summary)}}},
  author = {{{{The domino-data authors}}}},
  howpublished = {{Simulated with domino-data}},
  note = {{{len(seen)} {kind_of(summary)}; identifier {name}}}
}}

@article{{domino2026,
  title = {{Towards Generalizable Robotic Manipulation in Dynamic Environments}},
  year = {{2026}},
  journal = {{arXiv preprint arXiv:2603.15620}},
  url = {{{PAPER}}}
}}
"""
