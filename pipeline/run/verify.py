"""`domino-data verify`: every file of a dataset judged alone, and some episodes made again."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.crew.contract import Crew, Done
from pipeline.crew.loop import run
from pipeline.crew.ray_session import session
from pipeline.data.dataset import EDITED, Dataset
from pipeline.data.intact import kept_failures
from pipeline.data.reading import printable
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.rows import EPISODE
from pipeline.data.store.mirror import mirror_of
from pipeline.registry import UnknownName
from pipeline.run.file_checks import AGAIN, FileJob, Judged, judge
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.regenerate import is_image, regenerate

SECONDS = 3600.0  # what one file, or all attempts at a slot, may take before the worker counts as hung
PASSING = (".tmp", ".running")  # files that come and go while a build runs


def verify(dataset: Dataset, crew: Crew | None = None, progress: bool = False, again: int = 0) -> dict[str, Any]:
    """Judge every file of a dataset alone, and make `again` of its episodes again, chosen at random.

    Returns {"ok", "problems": one line each that begins with a path, "files": how many were judged,
    "episodes": how many are sound, "open": slots not built yet, "stale": episodes made by another
    version of code or recipe, "again": a line for each that was made again}. What is stale cannot be
    made again; a dataset with fewer than `again` others is not `ok`.

    Raises DatasetError for a directory that is no dataset, CrewError if workers cannot be started
    or do not last, and NoRenderer if nothing can be drawn again.
    """
    recipe, crew = dataset.recipe(), crew or Crew()
    problems = [f"{dataset.manifest.name}: {EDITED}"] if dataset.is_edited() else []
    slots = {} if problems else {_name(dataset, slot, done): slot for slot in recipe.slots() for done in (True, False)}
    paths, recorded = dict.fromkeys(_files_of(dataset)), _recorded(dataset, recipe) if slots else {}
    if slots:
        problems += _strays(paths, {*slots, *recorded})
        lost = sorted({path for path, sha256 in recorded.items() if sha256} - set(paths))
        problems += [f"{path}: is missing; {AGAIN}" for path in lost]
    with session(crew), tqdm(unit="file", disable=not progress, dynamic_ncols=True) as bar:
        jobs = list(_jobs(dataset, recipe, slots, recorded, paths))
        judged = list(_each(judge, jobs, crew, bar))
        sound = [each for each in judged if each.path.startswith("episodes/") and each.path.endswith(EPISODE) and not each.problems]
        fresh = [each.path for each in sound if slots and not each.stale]
        chosen = np.random.default_rng().permutation(len(fresh))[:again]
        jobs = [FileJob(str(dataset.root), fresh[number]) for number in sorted(chosen.tolist())]
        made = list(_each(make_again, jobs, crew, bar))
    problems += [f"{each.path}: {problem}" for each in judged + made for problem in each.problems]
    problems += _without_assets(dataset, judged, set(paths))
    _touch(dataset, [each.path for each in judged if each.problems])
    return {
        "ok": not problems and len(made) == again,
        "problems": [printable(problem) for problem in problems],
        "files": len(judged),
        "episodes": len(sound),
        "open": len({*slots.values()} - {slot for path, slot in slots.items() if path in recorded or path in paths}),
        "stale": sum(each.stale for each in judged),
        "again": [f"{each.path}: made again, {each.note}" for each in made if each.note],
    }


def make_again(job: FileJob) -> Judged:
    """Make an episode again, and compare it with the stored one: images only if the same device drew them."""
    found = regenerate(Dataset(Path(job.root)), job.path)
    state = [name for name in found.differ if not is_image(name)]
    images = [name for name in found.differ if is_image(name) and not found.device]
    note = f"state bytes {'differ' if state else 'equal'}, images "
    note += f"not compared ({found.device})" if found.device else "differ" if images else "equal"
    differ = ", ".join((state + images)[:5])
    return Judged(job.path, (f"made again, it differs in {differ}",) if differ else (), note=note)


def _files_of(dataset: Dataset) -> Iterator[str]:
    """The files of a dataset that a check exists for, and the directory of every export."""
    root, exports = dataset.root, dataset.root / "exports"
    for folder in ("episodes", "failures", "annotations", "assets/bodies"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in PASSING and (path.is_symlink() or not path.is_dir()):
                yield path.relative_to(root).as_posix()
    for path in sorted(exports.iterdir()) if exports.is_dir() else []:
        if not path.name.startswith("."):
            yield f"exports/{path.name}"
    for path in (dataset.attempts, dataset.provenance):
        if os.path.lexists(path):
            yield path.name


def _recorded(dataset: Dataset, recipe: Recipe) -> dict[str, str]:
    """The sha256 of every file of a slot, and of every failed attempt that is kept, by path."""
    rows = dataset.rows(recipe, "sha256")
    found = zip(rows.slots, rows.accepted.tolist(), rows.more["sha256"], strict=True)
    known = {_name(dataset, slot, accepted): sha256.hex() for slot, accepted, sha256 in found}
    return known | {path.relative_to(dataset.root).as_posix(): sha256 for _, path, sha256 in kept_failures(dataset, recipe)}


def _name(dataset: Dataset, slot: Slot, accepted: bool) -> str:
    """The path of the file of a slot below the dataset's directory."""
    return dataset.file(slot, accepted).relative_to(dataset.root).as_posix()


def _strays(paths: Iterable[str], known: set[str]) -> Iterator[str]:
    """Files that belong to nothing that the recipe wants."""
    for path in paths:
        if path.startswith(("episodes/", "failures/")) and path not in known:
            fix = "`gc` sets a whole episode aside" if path.startswith("episodes/") else "remove it"
            yield f"{path}: belongs to no slot of the recipe; {fix}"


def _jobs(
    dataset: Dataset, recipe: Recipe, slots: dict[str, Slot], recorded: dict[str, str], paths: Iterable[str]
) -> Iterator[FileJob]:
    """What is to be judged; where the recipe is not to be trusted, `slots` is empty and all are."""
    wanted, root = RecipeKeys(recipe), str(dataset.root.resolve())
    for path in paths:
        keys, slot = None, slots.get(path)
        if slots and slot is None and path.startswith("episodes/"):
            continue  # it belongs to no slot
        if slot is not None:
            with suppress(UnknownName):  # of a task that is not installed
                keys = wanted.of(slot)
        yield FileJob(root, path, recorded.get(path, ""), keys)


def _without_assets(dataset: Dataset, judged: Iterable[Judged], paths: set[str]) -> Iterator[str]:
    """Assets that episodes name and that are missing, each once."""
    named = {key: each.path for each in judged for key in each.assets}
    for key, path in named.items():
        asset = (dataset.bodies / key[:2] / f"{key}.npz").relative_to(dataset.root).as_posix()
        if asset not in paths:
            yield f"{asset}: is missing, and {path} was drawn from it; {AGAIN}"


def _each(work: Callable[[FileJob], Judged], jobs: Sequence[FileJob], crew: Crew, bar: "tqdm[Any]") -> Iterator[Judged]:
    """What the work makes of every job, in their order; a file that costs two workers is a problem."""
    done = dict[str, Judged]()
    bar.reset(len(jobs))
    with closing(run(lambda: work, deque(jobs), crew, SECONDS)) as ends:
        for end in ends:
            if isinstance(end, Done):
                done[end.job.path] = end.result
            else:
                why = f"{end.reason.replace('_', ' ')} twice while reading it; remove it, and {AGAIN}"
                done[end.job.path] = Judged(end.job.path, (why,))
            bar.update()
    yield from (done[job.path] for job in jobs)


def _touch(dataset: Dataset, paths: Iterable[str]) -> None:
    """Give damaged files another time of change, so that the next build reads them again."""
    if mirror_of(dataset.root) is None:
        for path in paths:
            with suppress(OSError):
                os.utime(dataset.root / path, follow_symlinks=False)
