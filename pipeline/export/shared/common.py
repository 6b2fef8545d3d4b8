"""What every exporter shares: one error, an atomic output directory, the order of episodes, and the facts one episode carries."""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.atomic import atomic_directory, sweep
from pipeline.data.disk import refusal
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.episode.state_log import StateLog
from pipeline.data.errors import DominoError
from pipeline.data.names import exported_names
from pipeline.data.parsing import parse_json
from pipeline.data.reading import read_regular
from pipeline.data.spec import EpisodeSpec
from pipeline.data.store.lock import exclusive
from pipeline.export.shared.contents import is_cache, strangers

SUMMARY = "export.json"
EPISODES, FAILURES = "episodes", "failures"
"""Splits of a dataset: what is exported where nothing else is said, and the failed attempts that are kept."""

SOURCES = "sources.json"
"""What the files of an export were made from (`reuse`)."""

OWN = ("episodes", "failures", "ledger", "assets", "annotations", "report")
"""Directories of a dataset that nothing else may be written to."""

CLOCK_TOLERANCE = 1e-6  # s
Progress = Callable[[int], object] | None


class ExportError(DominoError):
    """An export that cannot be made; the message names the file and what is wrong with it."""


@dataclass(frozen=True, eq=False)
class Facts:
    """One episode without its images: T frames on an exact clock, and the instruction chosen for it.

    `source` is the path relative to the dataset, `log` is in float64; `cameras` are the names in the file, sorted; `size` is the
    image size (H, W) in pixels, the same for every camera.
    """

    source: str
    spec: EpisodeSpec
    fps: int
    log: StateLog
    target: NDArray[np.float64]  # (T, 7) world pose
    instruction: str
    seen: list[str]
    unseen: list[str]
    motion: str
    meta: EpisodeMeta
    cameras: tuple[str, ...]
    size: tuple[int, int]
    camera_poses: Mapping[str, NDArray[np.float64]]  # (T, 7) world poses by camera
    interception: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])  # the group of that name
    kept: int = 0  # frames that are exported, from the first one on

    def __len__(self) -> int:
        return len(self.log)

    @property
    def spins(self) -> bool:
        """Whether the file holds the target's angular velocity; those of earlier versions do not."""
        return self.log.target_angular_velocity is not None

    @property
    def corrected(self) -> bool:
        """Whether a policy acts before the expert does."""
        return self.log.intervention is not None


def choose_instruction(spec: EpisodeSpec, seen: Sequence[str]) -> str:
    """The one of the seen instructions that an export attaches to this episode; a function of spec and list only."""
    return seen[int(spec.rng("export_instruction").integers(len(seen)))]


def sort_episodes(episodes: Sequence[Path]) -> list[Path]:
    """Episodes in the order of every export: sorted paths. Raises ExportError when there are none or one comes twice."""
    paths = sorted((Path(p) for p in episodes), key=lambda p: p.as_posix())
    if not paths:
        raise ExportError("there are no episodes to export; run the build first")
    twice = next((a for a, b in pairwise(paths) if a == b), None)
    if twice is not None:
        raise ExportError(f"{twice}: given twice")
    return paths


def by_embodiment(episodes: Sequence[Path], out: Path) -> dict[str, tuple[Path, list[Path]]]:
    """Embodiment -> (directory, its episodes in order): `out` itself for one embodiment, else `out/<embodiment>`.

    Vectors of different embodiments differ in width and meaning, so formats with one shape per dataset get one dataset each.
    """
    groups = group_episodes(episodes, lambda spec: spec.embodiment)
    single = len(groups) == 1
    return {name: (out if single else out / name, paths) for name, paths in groups.items()}


def group_episodes(episodes: Sequence[Path], key: Callable[[EpisodeSpec], str]) -> dict[str, list[Path]]:
    """Episodes in order by a key of their spec; the keys are sorted."""
    groups: dict[str, list[Path]] = {}
    for path in sort_episodes(episodes):
        with reading(path) as file:
            groups.setdefault(key(file.spec), []).append(path)
    return {name: groups[name] for name in sorted(groups)}


@contextmanager
def reading(path: Path) -> Iterator[EpisodeFile]:
    """Open an episode; whatever is wrong with the file comes out as ExportError naming it.

    An OSError within the block is not the episode's, whose own come out as EpisodeError: it passes.
    """
    try:
        with EpisodeFile(path) as file:
            yield file
    except EpisodeError as error:
        message = str(error)
        raise ExportError(message if str(path) in message else f"{path}: {message}") from error
    except OSError:  # some are ValueErrors, too
        raise
    except (KeyError, ValueError) as error:
        raise ExportError(f"{path}: is not a complete episode ({error}); delete it and run the build again") from error


EXPORT_FAULTS = (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError, ValueError)
"""What readers of other formats raise for a damaged file."""


@contextmanager
def judging(place: Path, problems: list[str]) -> Iterator[None]:
    """Within `reading`, around all that reads an export: what goes wrong there is a problem of the export at `place`.

    What is wrong with the episode comes out as EpisodeError or ExportError as before.
    """
    try:
        yield
    except (*EXPORT_FAULTS, pa.ArrowException) as error:
        problems.append(f"{place}: cannot be read ({' '.join(str(error).split())[:200]})")


def read_facts(file: EpisodeFile, dataset: Path, after_success: float | None = None) -> Facts:
    """Everything but the images of an open episode, which is exported until `after_success` seconds after its success, if given.

    Raises ExportError for an episode that breaks its own promises: frames off the fps grid, arrays of different lengths, values
    that are not finite, no instruction, cameras of different sizes.
    """
    episode = file.read()
    log, path = episode.log, file.path
    seen, unseen = list(episode.instructions["seen"]), list(episode.instructions["unseen"])
    if not seen:
        raise ExportError(f"{path}: has no instruction")
    frames = len(log)
    if frames == 0:
        raise ExportError(f"{path}: has no frames")
    if np.abs(log.times - log.times[0] - np.arange(frames) / file.fps).max() > CLOCK_TOLERANCE:
        raise ExportError(f"{path}: frames are not {file.fps} per second")
    target = file.array("target/pose")
    arrays = {
        "state": log.state,
        "action": log.action,
        "target pose": target,
        "target velocity": log.target_velocity,
        "tcp": log.tcp,
        **({} if log.target_angular_velocity is None else {"target angular velocity": log.target_angular_velocity}),
    }
    for name, value in arrays.items():
        if len(value) != frames:
            raise ExportError(f"{path}: {name} has {len(value)} rows for {frames} frames")
        if not np.isfinite(value).all():
            raise ExportError(f"{path}: {name} holds values that are not finite")
    if not episode.cameras:
        raise ExportError(f"{path}: has no cameras")
    sizes, camera_poses = set(), {}
    for camera in episode.cameras:
        camera_poses[camera] = file.array(f"observation/{camera}/pose")
        count = len(camera_poses[camera])
        if count != frames:
            raise ExportError(f"{path}: {camera} has {count} images for {frames} frames")
        sizes.add(file.size(camera))
    if len(sizes) > 1:
        raise ExportError(f"{path}: its cameras differ in size: {sorted(sizes)}")
    return Facts(
        source=source_of(path, dataset),
        spec=episode.spec,
        fps=file.fps,
        log=log,
        target=target,
        instruction=choose_instruction(episode.spec, seen),
        seen=seen,
        unseen=unseen,
        motion=episode.motion,
        meta=episode.meta,
        cameras=episode.cameras,
        size=sizes.pop(),
        camera_poses=camera_poses,
        interception=episode.interception,
        kept=frames if after_success is None else log.frames_until("success", after_success),
    )


def source_of(path: Path, dataset: Path) -> str:
    """The name of an episode file in exports: relative to the dataset where it is there."""
    path, dataset = path.absolute(), dataset.absolute()
    return path.relative_to(dataset).as_posix() if path.is_relative_to(dataset) else path.name


def same(first: Facts, facts: Facts) -> None:
    """Raise ExportError unless two episodes fit into one dataset: the same fps, cameras, image size and joint names."""
    pairs = {
        "fps": (first.fps, facts.fps),
        "cameras": (first.cameras, facts.cameras),
        "image size": (first.size, facts.size),
        "joint names": (first.log.vector_names, facts.log.vector_names),
        "failed": (first.meta.failure is not None, facts.meta.failure is not None),
        "corrected": (first.corrected, facts.corrected),
        "target's angular velocity": (first.spins, facts.spins),
    }
    for name, (want, got) in pairs.items():
        if want != got:
            raise ExportError(f"{facts.source}: {name} {got} differs from {want} of {first.source}; export them separately")


def exported_cameras(facts: Facts, given: Mapping[str, str]) -> dict[str, str]:
    """Exported name of each camera of an episode, those `given` first. Raises ExportError, naming the option, if that fails."""
    try:
        return exported_names(facts.cameras, given)
    except ValueError as error:
        raise ExportError(f"--camera-names: {error}") from error


def read_summary(out: Path) -> dict[str, Any]:
    """export.json of an export. Raises ExportError if it cannot be read."""
    try:
        return dict(parse_json(read_regular(out / SUMMARY)))
    except (OSError, ValueError, TypeError) as error:
        raise ExportError(f"{out}: has no readable {SUMMARY} ({error})") from error


def foreign_files(out: Path) -> list[Path]:
    """Files in the directory of an export that are neither part of it nor a cache of what reads it, sorted."""
    return [path for path in unlisted_files(out) if not is_cache(out, path)]


def unlisted_files(out: Path) -> list[Path]:
    """Files in the directory of an export that are no part of it, sorted; [] where its export.json does not name its files."""
    try:
        names = read_summary(out).get("contents")
    except ExportError:
        return []
    return strangers(out, names) if isinstance(names, list) else []


def json_text(value: Any) -> str:
    """Indented JSON, keys sorted, newline at the end."""
    return json.dumps(value, indent=2, sort_keys=True) + "\n"


def write_json(path: Path, value: Any) -> None:
    """Write `json_text`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json_text(value))


@contextmanager
def stage_directory(out: Path, dataset: Path) -> Iterator[Path]:
    """A temporary directory beside `out` that becomes `out` when the block ends well and vanishes when it does not.

    An existing export at `out` is replaced only then. Raises ExportError if `out` is something else than an export, or holds
    files that are no part of it, contains the dataset or lies among its own files, or the disk refuses,
    and Busy if another command is replacing that export.
    """
    out, here = Path(os.path.abspath(out)), Path(dataset).resolve()
    if out.exists() and not out.is_dir():
        raise ExportError(f"{out}: is a file; name a directory")
    real = out.resolve()
    if here.is_relative_to(real):
        raise ExportError(f"{out}: holds the dataset itself; name another directory")
    if any(real.is_relative_to(here / own) for own in OWN):
        raise ExportError(f"{out}: lies among the dataset's own files; name a directory below {dataset}/exports, or elsewhere")
    if out.exists() and any(out.iterdir()) and not (out / SUMMARY).exists():
        raise ExportError(f"{out}: is not an export (it has no {SUMMARY}); remove it or name another directory")
    if foreign := foreign_files(out):
        raise ExportError(f"{foreign[0]}: is no part of the export that stands there; move it away or name another directory")
    try:
        sweep(out.parent, f".{out.name}.*.tmp")
        # what stands there lends its files (reuse.py): they must be those that were judged
        with exclusive(out) if out.is_dir() else nullcontext(), atomic_directory(out) as temporary:
            yield temporary
    except OSError as error:
        raise ExportError(f"{out}: cannot be written: {refusal(error)}; nothing was changed there: export again") from error
