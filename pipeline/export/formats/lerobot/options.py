"""Options of the LeRobot formats, and their datasets."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.data.actions import ACTIONS, Representation
from pipeline.data.parsing import real
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.export.options import (
    LabelOptions,
    camera_names_option,
    one_of,
    option,
    several_of,
    whole,
)
from pipeline.export.shared.episodes import ExportError, by_embodiment, group_episodes
from pipeline.export.shared.video import CODECS, Codec

INDEX = "index.json"
MEGABYTE = 1024**2
EPISODES_PER_DATASET = 50_000
"""A repository of the hub holds at most 100,000 files and lists 10,000 of a folder."""


@dataclass(frozen=True)
class LerobotOptions(LabelOptions):
    codec: str = option(f"video encoder: {', '.join(CODECS)}", one_of(*CODECS), Codec.name)
    crf: int | None = option("quality of the video, lower is better and larger", whole(0, 63), None)
    preset: str | None = option(
        "preset of the video encoder, like veryfast (h264, hevc) or 12 (libsvtav1)", str, None
    )
    gop: int = option("frames from one key frame to the next", whole(1, 10_000), 1)
    per_task: bool = option(
        "one dataset for every task and level, with an index.json", default=False
    )
    camera_names: Mapping[str, str] = camera_names_option()
    after_success: float | None = option(
        "seconds after the success with which episodes end, negative for before it; without it they"
        " are whole",
        partial(real, low=-3600, high=3600),
        None,
    )
    more_actions: tuple[str, ...] = option(
        "further representations of the action, as features like action.ee: ee,joints-delta",
        several_of(*ACTIONS),
        (),
        quiet=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.actions in self.more_actions:
            raise ExportError(f"--more-actions {self.actions}: the feature action is that already")

    @property
    def representations(self) -> tuple[Representation, ...]:
        return (self.representation, *self.more_representations)

    @property
    def more_representations(self) -> tuple[Representation, ...]:
        return tuple(replace(self.representation, actions=name) for name in self.more_actions)

    def video(self) -> Codec:
        codec = Codec(self.codec, self.crf, self.gop, self.preset)
        codec.check()
        return codec


@dataclass(frozen=True)
class LerobotV3Options(LerobotOptions):
    """When data and videos begin another file, together. lerobot compares float32 times within 1e-4
    s, whose steps are larger beyond 1024 s."""

    data_bytes: int = option(
        "bytes of a data file after which another begins", whole(1), 100 * MEGABYTE
    )
    video_bytes: int = option("bytes that a video file does not exceed", whole(1), 200 * MEGABYTE)
    video_seconds: int = option("seconds that a video file does not exceed", whole(1, 86_400), 1000)
    depth: bool = option(
        "also write depth maps, to files of their own that policies do not read", default=False
    )


def datasets_of(
    episodes: Sequence[Path], out: Path, per_task: bool
) -> dict[str, tuple[Path, list[Path]]]:
    """Name -> (directory, episodes), by embodiment, cell, or level above EPISODES_PER_DATASET."""
    if per_task:
        groups = group_episodes(episodes, _cell)
    else:
        groups = group_episodes(episodes, lambda spec: f"{spec.embodiment}/L{spec.level}")
        sizes = Counter[str]()
        for name, paths in groups.items():
            sizes[name.split("/")[0]] += len(paths)
        if max(sizes.values()) <= EPISODES_PER_DATASET:
            return by_embodiment(episodes, out)
    return {name: (out / name, paths) for name, paths in groups.items()}


def _cell(spec: EpisodeSpec) -> str:
    task, rest = Cell.of(spec).path.split("/", 1)
    return f"{rest}/{task}"


def index_row(
    path: str, summary: Mapping[str, Any], specs: Sequence[EpisodeSpec]
) -> dict[str, Any]:
    kinds = {"tasks": "task", "levels": "level", "alphas": "alpha", "domains": "domain"}
    return {
        "path": path,
        "embodiment": specs[0].embodiment,
        **{key: sorted({getattr(spec, name) for spec in specs}) for key, name in kinds.items()},
        **{name: summary[name] for name in ("episodes", "frames", "fps")},
    }
