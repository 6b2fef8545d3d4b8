"""`domino-data verify`: checks every file, and makes some episodes again."""

import os
import re
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.crew.contract import Crew, Died
from pipeline.crew.loop import run
from pipeline.crew.ray_session import session
from pipeline.data.dataset import EDITED, Dataset
from pipeline.data.intact import kept_failures, named_slot
from pipeline.data.reading import printable
from pipeline.data.slots.files import EPISODE
from pipeline.data.store.place import place_of
from pipeline.run.names import check_trust
from pipeline.run.state import DONE, OPEN, states

from .file_checks import AGAIN, FileJob, judge
from .regenerate import is_image, other_device, regenerate

# what one file, or all attempts at a slot, may take before the worker counts as hung
SECONDS = 3600.0
CHECKED = r"""(?x) (attempts|provenance)\.\w+ | exports/[^.].* |
(episodes|failures|annotations|assets/bodies) / .* (?<!\.tmp) (?<!\.running)"""
"""Names of files but those that come and go while a build runs."""
OF_RECIPE = {"slot", "recipe"}  # parts of keys that no other version of the code changes


def verify(
    dataset: Dataset,
    crew: Crew | None = None,
    progress: bool = False,
    again: int = 0,
    trust: bool = False,
    episode: str | None = None,
) -> dict[str, Any]:
    """Check every file of a dataset, or one `episode`, and make `again` random episodes again.

    Returns {"ok", "problems": lines that begin with a path, "files", "episodes": sound ones,
    "open", "stale", "again": a line each}. Stale episodes cannot be made again; a dataset with
    fewer than `again` others is not `ok`.

    Raises DatasetError, CrewError, NoRenderer, and Untrusted for another's policy unless `trust`.
    """
    if (again or episode) and not trust:
        check_trust(dataset.recipe().corrections, str(dataset.root))
    crew, root = crew or Crew(), str(dataset.root.resolve())
    if episode is None:
        paths = _files_of(dataset)
        known = _compare(dataset, set(paths))
    else:
        again = 1
        slot = named_slot(dataset, dataset.recipe(), episode)
        paths = [_name(dataset, dataset.episode(slot))]
        known = Comparison(current=set(paths))
    files = [path for path in paths if path not in known.strays]
    jobs = [FileJob(root, path, known.hashes.get(path, "")) for path in files]
    with session(crew), tqdm(unit="file", disable=not progress, dynamic_ncols=True) as bar:
        judged = _each(judge, jobs, crew, bar)
        sound = [
            path
            for path, problems in judged.items()
            if path.startswith("episodes/") and path.endswith(EPISODE) and not problems
        ]
        fresh = [path for path in (paths if episode else sound) if path in known.current]
        chosen = np.random.default_rng().permutation(len(fresh))[:again]
        chosen_jobs = [FileJob(root, fresh[number]) for number in sorted(chosen.tolist())]
        made = _each(_differ, chosen_jobs, crew, bar)
    problems, lines = known.problems, list[str]()
    for path, found in judged.items():
        problems += [f"{path}: {problem}" for problem in found]
        if found and path.startswith("episodes/"):
            with suppress(OSError):  # another time of change, so that the next build reads it
                os.utime(dataset.root / path, follow_symlinks=False)
    device = other_device(dataset) if made else ""
    for path, names in made.items():
        images = [name for name in names if is_image(name)]
        state = [name for name in names if name not in images]
        compared = f"not compared ({device})" if device else "differ" if images else "equal"
        lines.append(
            f"{path}: made again, state bytes {'differ' if state else 'equal'}, images {compared}"
        )
        if differ := state + ([] if device else images):
            problems.append(f"{path}: made again, it differs in {', '.join(differ[:5])}")
    return {
        "ok": not problems and len(made) == again,
        "problems": [printable(problem) for problem in problems],
        "files": len(judged),
        "episodes": len(sound),
        "open": known.open,
        "stale": known.stale,
        "again": lines,
    }


def _files_of(dataset: Dataset) -> list[str]:
    """Checkable files of a dataset, and export directories."""
    root, place = dataset.root, place_of(dataset.root)
    here = (path for path in root.rglob("*") if path.is_symlink() or not path.is_dir())
    names = (path.relative_to(root).as_posix() for path in (place.files(".*") if place else here))
    checked = (name for name in names if re.fullmatch(CHECKED, name))
    return sorted({re.sub("^(exports/[^/]+)/.*", r"\1", name) for name in checked})


@dataclass
class Comparison:
    """What recipe and index state about a dataset's files, by path. `strays` belong to no slot,
    `current` are up to date; `stale` and `open` count slots.
    """

    hashes: dict[str, str] = field(default_factory=dict[str, str])
    strays: set[str] = field(default_factory=set[str])
    current: set[str] = field(default_factory=set[str])
    problems: list[str] = field(default_factory=list[str])
    stale: int = 0
    open: int = 0


def _compare(dataset: Dataset, paths: set[str]) -> Comparison:
    if dataset.is_edited():
        return Comparison(problems=[f"{dataset.manifest.name}: {EDITED}"])
    known, recipe, slots = Comparison(), dataset.recipe(), set[str]()
    rows = dataset.rows(recipe, "sha256", "assets")
    columns = zip(rows.slots, rows.accepted.tolist(), rows.more["sha256"], strict=True)
    for slot, accepted, sha256 in columns:
        known.hashes[_name(dataset, dataset.file(slot, accepted))] = sha256.hex()
    for _, path, sha256 in kept_failures(dataset, recipe):
        known.hashes[_name(dataset, path)] = sha256
    for slot, state in states(dataset, recipe):
        places = [_name(dataset, dataset.file(slot, accepted)) for accepted in (True, False)]
        slots.update(places)
        there = [path for path in places if path in paths]
        known.open += not there and state.accepted is None
        known.current.update(there if state.todo == DONE else ())
        known.stale += bool(there) and state.todo not in (DONE, OPEN)
        if there and (other := OF_RECIPE.intersection(state.because)):
            why = ", ".join(sorted(other))
            known.problems.append(
                f"{there[0]}: its keys are not those of the recipe ({why}); {AGAIN}"
            )
    of_slots = {path for path in paths if path.startswith(("episodes/", "failures/"))}
    known.strays = of_slots - slots - known.hashes.keys()
    for path in sorted(known.strays):
        fix = "`gc` sets a whole episode aside" if path.startswith("episodes/") else "remove it"
        known.problems.append(f"{path}: belongs to no slot of the recipe; {fix}")
    assets = dataset.ask(lambda index: index.assets())
    keys = {assets[int(number)] for text in rows.more["assets"] for number in text.split()}
    named = (_name(dataset, dataset.bodies / key[:2] / f"{key}.npz") for key in sorted(keys))
    for path in [*sorted(known.hashes), *named]:
        if path not in paths:
            known.problems.append(f"{path}: is missing; {AGAIN}")
    return known


def _name(dataset: Dataset, path: Path) -> str:
    return path.relative_to(dataset.root).as_posix()


def _differ(job: FileJob) -> list[str]:
    return regenerate(Dataset(Path(job.root)), job.path)


def _each(
    work: Callable[[FileJob], list[str]], jobs: Sequence[FileJob], crew: Crew, bar: "tqdm[Any]"
) -> dict[str, list[str]]:
    """Findings by path in job order; a file that costs two workers is a problem."""
    found = {job.path: list[str]() for job in jobs}
    bar.reset(len(jobs))
    with closing(run(lambda: work, deque(jobs), crew, SECONDS)) as ends:
        for end in ends:
            if isinstance(end, Died):
                lost = end.reason.replace("_", " ")
                found[end.job.path] = [f"{lost} twice over it; remove it, and {AGAIN}"]
            else:
                found[end.job.path] = end.result
            bar.update()
    return found
