"""Order, groups and facts of exported episodes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.actions import JOINTS, ActionCodec, Representation
from pipeline.data.episode.events import exchanged
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.episode.state_log import StateLog
from pipeline.data.errors import DominoError
from pipeline.data.names import exported_names
from pipeline.data.process.machine import directories
from pipeline.data.slots import select
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Floats, compose, inverse

EPISODES, FAILURES = "episodes", "failures"
"""Splits of a dataset: accepted episodes, and the failed attempts that are kept."""

CLOCK_TOLERANCE = 1e-6  # s
TOOL_TOLERANCE = 1e-3  # m and rad
Progress = Callable[[int], object] | None


class ExportError(DominoError): ...


@dataclass(frozen=True, eq=False)
class Facts:
    """One episode without its images. `source` is relative to the dataset, `size` is (H, W)."""

    source: str
    spec: EpisodeSpec
    fps: int
    log: StateLog
    target: Floats  # (T, 7) world pose
    instruction: str
    seen: list[str]
    unseen: list[str]
    motion: str
    meta: EpisodeMeta
    cameras: tuple[str, ...]
    size: tuple[int, int]
    camera_poses: Mapping[str, Floats]  # (T, 7) world poses
    interception: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    kept: int = 0  # the first frames, which are exported
    representation: Representation = JOINTS
    more: tuple[Representation, ...] = ()  # exported beside it
    labels: tuple[str, ...] = ()
    after: str = ""  # the instruction once an event has changed it

    @cached_property
    def spoken(self) -> list[str]:
        """The instruction of each frame (T,)."""
        span = exchanged(self.meta.events, self.log.events) if self.after else None
        holds = np.zeros(len(self), bool) if span is None else span.holds(self.log.times)
        return [self.after if late else self.instruction for late in holds]

    @property
    def told(self) -> list[str]:
        """The instructions of the exported frames, each once."""
        return list(dict.fromkeys(self.spoken[: self.kept]))

    def __len__(self) -> int:
        return len(self.log)

    @property
    def dataset(self) -> str:
        """Its dataset in an export of several, else ""."""
        first, _, rest = self.source.partition("/")
        return first if rest and first not in (EPISODES, FAILURES) else ""

    @property
    def spins(self) -> bool:
        """Old files have no angular velocity of the target."""
        return self.log.target_angular_velocity is not None

    @property
    def action_names(self) -> list[str]:
        return self.names_in(self.representation)

    def names_in(self, representation: Representation) -> list[str]:
        return list(representation.names(self.log.vector_names))

    @property
    def action(self) -> Floats:
        """The commands (T,D) for the interval after each frame."""
        return self.written(self.log.action, self.representation)

    def written(self, commanded: Floats, representation: Representation) -> Floats:
        """Joint targets (T,A) as (T,D). Raises ExportError for another robot."""
        joints = ActionCodec(JOINTS, self.log.vector_names)
        codec = self._codec if representation.poses else joints
        codec = replace(codec, representation=representation)
        return codec.encode(commanded, codec.references(self.log.action, self.log.state))

    @cached_property
    def _codec(self) -> ActionCodec:
        from pipeline.data.chains import read_chains  # most exports need no kinematics

        folders = [directory / "robots" for directory in directories()]
        arms = read_chains(self.spec.embodiment, self.meta.layout, self.meta.table_drop, folders)
        codec = ActionCodec(JOINTS, self.log.vector_names, arms)
        apart = np.abs(compose(inverse(codec.tools(self.log.state)[0]), self.log.tcp))
        if max(apart[..., :3].max(), apart[..., 4:].max()) > TOOL_TOLERANCE:
            raise ExportError(
                f"{self.source}: was recorded with another {self.spec.embodiment} than the one"
                " installed, so its tool poses are not known: export --actions joints"
            )
        return codec

    @property
    def corrected(self) -> bool:
        return self.log.intervention is not None

    @property
    def eventful(self) -> bool:
        return bool(self.meta.events)

    @property
    def paired(self) -> bool:
        return bool(self.spec.arm)


def described_action(facts: Facts) -> dict[str, Any]:
    """What the summary states about an action; nothing for joint targets."""
    if facts.representation == JOINTS:
        return {}
    return {"action": facts.representation.describe(), "action_names": facts.action_names}


def choose_instruction(spec: EpisodeSpec, seen: Sequence[str]) -> str:
    return seen[int(spec.rng("export_instruction").integers(len(seen)))]


def sort_episodes(episodes: Sequence[Path]) -> list[Path]:
    paths = sorted((Path(p) for p in episodes), key=lambda p: p.as_posix())
    if not paths:
        raise ExportError("there are no episodes to export; run the build first")
    if twice := [a for a, b in pairwise(paths) if a == b]:
        raise ExportError(f"{twice[0]}: given twice")
    return paths


def by_embodiment(episodes: Sequence[Path], out: Path) -> dict[str, tuple[Path, list[Path]]]:
    groups = group_episodes(episodes, lambda spec: spec.embodiment)
    return {
        name: (out if len(groups) == 1 else out / name, paths) for name, paths in groups.items()
    }


def group_episodes(
    episodes: Sequence[Path], key: Callable[[EpisodeSpec], str]
) -> dict[str, list[Path]]:
    groups: dict[str, list[Path]] = {}
    for path in sort_episodes(episodes):
        with reading(path) as file:
            groups.setdefault(key(file.spec), []).append(path)
    return dict(sorted(groups.items()))


@contextmanager
def reading(path: Path) -> Iterator[EpisodeFile]:
    """A damaged file is an ExportError. Other OSErrors pass."""
    try:
        with EpisodeFile(path) as file:
            yield file
    except EpisodeError as error:
        message = str(error)
        raise ExportError(message if str(path) in message else f"{path}: {message}") from error
    except OSError:  # some are ValueErrors, too
        raise
    except (KeyError, ValueError) as error:
        raise ExportError(
            f"{path}: is not a complete episode ({error}); delete it and run the build again"
        ) from error


def read_facts(
    file: EpisodeFile,
    dataset: Path,
    after_success: float | None = None,
    representation: Representation = JOINTS,
) -> Facts:
    """All but the images, until `after_success` s after the success. Raises ExportError."""
    episode, path, frames = file.read(), file.path, len(file)
    log, target, cameras = episode.log, file.array("target/pose"), episode.cameras
    seen, unseen = (list(episode.instructions[name]) for name in ("seen", "unseen"))
    if not seen:
        raise ExportError(f"{path}: has no instruction")
    if np.abs(log.times - log.times[0] - np.arange(frames) / file.fps).max() > CLOCK_TOLERANCE:
        raise ExportError(f"{path}: frames are not {file.fps} per second")
    for name, value in {"state": log.state, "action": log.action, "target pose": target}.items():
        if len(value) != frames:
            raise ExportError(f"{path}: {name} has {len(value)} rows for {frames} frames")
    poses = {camera: file.array(f"observation/{camera}/pose") for camera in cameras}
    for camera, values in poses.items():
        if len(values) != frames:
            raise ExportError(f"{path}: {camera} has {len(values)} images for {frames} frames")
    sizes = {file.size(camera) for camera in cameras}
    if len(sizes) != 1:
        raise ExportError(f"{path}: cameras of one size are needed, not {sorted(sizes)}")
    return Facts(
        *(source_of(path, dataset), episode.spec, file.fps, log, target),
        *(choose_instruction(episode.spec, seen), seen, unseen, episode.motion, episode.meta),
        *(cameras, sizes.pop(), poses, episode.interception),
        frames if after_success is None else log.frames_until("success", after_success),
        representation,
        after=choose_instruction(episode.spec, episode.instructions.get("seen_after") or [""]),
    )


def source_of(path: Path, dataset: Path) -> str:
    """Relative to the dataset if there, else the file's name."""
    path, dataset = path.absolute(), dataset.absolute()
    return path.relative_to(dataset).as_posix() if path.is_relative_to(dataset) else path.name


def same(first: Facts, facts: Facts) -> None:
    """Raise ExportError unless both fit into one dataset."""
    told, wanted = (
        {
            "fps": one.fps,
            "cameras": one.cameras,
            "image size": one.size,
            "joint names": one.log.vector_names,
            "failed": one.meta.failure is not None,
            "corrected": one.corrected,
            "events": one.eventful,
            "pairs": one.paired,
            "target's angular velocity": one.spins,
        }
        for one in (facts, first)
    )
    for name, value in told.items():
        if value != wanted[name]:
            differs = f"{name} {value} differs from {wanted[name]} of {first.source}"
            raise ExportError(f"{facts.source}: {differs}; export them separately")


def exported_cameras(facts: Facts, given: Mapping[str, str]) -> dict[str, str]:
    """Exported name of each camera, those `given` first. Raises ExportError."""
    try:
        return exported_names(facts.cameras, given)
    except ValueError as error:
        raise ExportError(f"--camera-names: {error}") from error


def select_episodes(
    episodes: Sequence[Path],
    where: str,
    validation: float = select.VALIDATION,
    attempts: Callable[[], select.Attempts] = dict,
) -> list[Path]:
    """Episodes that fit `where`, all for "". Raises WhereError, ExportError."""
    if not where:
        return list(episodes)
    wanted, known = select.parse_where(where), attempts()
    columns = list[dict[str, Any]]()
    for path in episodes:
        with reading(path) as file:
            columns.append(select.columns_of(file, known, validation))
    chosen = [episodes[row] for row in np.flatnonzero(select.select_rows(columns, wanted))]
    if not chosen:
        held = select.values_in(columns, where)
        held = held or "`domino-data status` lists what the dataset holds"
        raise ExportError(f"no episode fits --where {where!r}: {held}")
    return chosen
