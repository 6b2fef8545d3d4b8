"""All checks of a dataset: every file judged by itself, on as many workers as wanted, then what concerns them all."""

import os
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.crew.ray_session import session
from pipeline.data.dataset import Dataset
from pipeline.data.ledger.entries import Files
from pipeline.data.ledger.files import group_of
from pipeline.data.ledger.lookup import Lookup
from pipeline.data.ledger.stamps import DAMAGED
from pipeline.data.reading import printable
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.store.lock import Busy, exclusive
from pipeline.data.store.mirror import free_space, mirror_of
from pipeline.run.names import installed_recipe
from pipeline.run.state import DONE, OPEN, SlotState, states
from pipeline.run.verify import layout
from pipeline.run.verify.episode import Judged, judge_episode, judge_images, other_device
from pipeline.run.verify.stored import check_assets, check_export, check_stage, exports_of
from pipeline.run.verify.tally import Finding, Tally
from pipeline.world.drawing.vulkan import ensure_renderer

CONTACT_SECONDS, CONTACT_METRES = 0.1, 0.01
EPISODE_SECONDS = 600.0  # what judging one episode may take before its worker counts as hung
DIRECTORY_SECONDS = 24 * 3600.0  # the same for an export or a stage of annotations, each one job


@dataclass(frozen=True)
class Job:
    """What a worker judges: a slot, of which it renders `draw` frames again, or the directory of a stage or an export (relative to
    the dataset), with its episodes."""

    root: str
    recipe: Recipe
    slot: Slot | None = None
    draw: int = 0
    directory: str = ""
    episodes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The slot's path or the directory."""
        return self.slot.path if self.slot else self.directory


def verify(dataset: Dataset, crew: Crew | None = None, progress: bool = False, draw: int = 0) -> dict[str, Any]:
    """Check every file of a dataset. Returns {"ok", "problems", "episodes", "open", "uncompared", "checks": [...], "meeting":
    {task: medians}}: how many problems there are, episodes without one, slots that were not tried yet, and episodes whose images
    were to be compared and cannot be.

    Of every episode, `draw` frames of each camera are rendered again and compared. An episode that this version, or the device
    here, would render differently cannot be compared, and the dataset is not `ok` then.
    Slots that were not tried yet are no problem, and nothing of them is counted as checked. Raises DatasetError for a directory
    that is no dataset or needs names that are not installed, CrewError if workers cannot be started or do not last, and
    NoRenderer if nothing can be rendered.
    """
    recipe, tally, crew = installed_recipe(dataset), Tally(), crew or Crew()
    device = other_device(dataset, ensure_renderer()) if draw else ""
    root = str(dataset.root.resolve())
    damaged = layout.damaged_groups(dataset, recipe)
    tally.add(layout.check_ledger(dataset, recipe, damaged))
    entries, found = dataset.entries(recipe, ()), list(states(dataset, recipe))
    recorded = {*entries.slots, *entries.impossible}
    jobs = [Job(root, recipe, slot, 0 if device else draw) for slot, _ in found if slot in recorded]
    files = Files(dataset.episodes)
    without = [slot for slot, _ in found if slot not in recorded and files.there(slot)]
    # where the ledger is damaged, it is to blame
    unknown = [dataset.episode(slot).relative_to(dataset.root) for slot in without if group_of(slot) not in damaged]
    tally.add(Finding("files", f"{path}: has no ledger entry; {layout.AGAIN}") for path in unknown)
    stages = sorted(p for p in dataset.root.glob("annotations/*") if p.is_dir())
    with session(crew), tqdm(total=0, unit="job", disable=not progress, dynamic_ncols=True) as bar:

        def counted(jobs: Iterable[Job]) -> list[Judged]:
            found = list(_judge(jobs, crew, bar))
            for each in found:
                tally.add_counted(each.looked, each.findings)
            return found

        judged = counted(jobs)
        sound = [each for each in judged if each.sound]
        annotated = counted(Job(root, recipe, directory=str(p.relative_to(dataset.root))) for p in stages)
        exports, hindered = exports_of(dataset), _hindrance(dataset, found, recorded, [*sound, *annotated])
        hindered = "not compared while the ledger is damaged" if damaged else hindered
        paths = tuple(str(dataset.episode(each.slot).resolve()) for each in sound)
        if not hindered:
            counted(Job(root, recipe, directory=str(p.relative_to(dataset.root)), episodes=paths) for p in exports)
    for place in exports if hindered else []:
        tally[f"export {place.name}"].note = hindered
    tally.add(layout.check_strays(dataset, recipe))
    tally.add(layout.check_failures(dataset, recipe))
    names = [(dataset.episode(each.slot).relative_to(dataset.root).as_posix(), each.assets) for each in sound]
    findings, decayed = check_assets(dataset, names)
    tally.add(findings)
    unnoted = condemn(dataset, recipe, {each.slot for each in judged if each.damaged}, {each.slot for each in sound}, decayed)
    waiting = sum(state.accepted is None for _, state in found)
    if damaged or entries.impossible:
        tally["attempts"].note = "not compared while the ledger is damaged"
    else:
        tally.add(layout.check_attempts(dataset, recipe, not waiting))
    tally.add(layout.check_provenance(dataset, not waiting))
    stale = sum(state.todo not in (DONE, OPEN) for _, state in found)
    notes = [f"{waiting} slots not built yet"] * bool(waiting)
    notes += [unnoted] * bool(unnoted)
    notes += [f"{stale} made by another version of code or recipe, see status"] * bool(stale)
    tally["files"].note = ", ".join(notes)
    uncompared = [device or each.uncompared for each in sound if draw and (device or each.uncompared)]
    if uncompared:
        why = printable(", ".join(sorted(set(uncompared))))
        tally["images"].undecided = f"{len(uncompared)} episodes cannot be compared ({why})"
    medians = _medians(sound)
    _summarise_meetings(tally, medians)
    checks = [check.as_dict() for check in tally.checks.values()]
    problems = sum(len(c["problems"]) for c in checks)
    counts = {"ok": all(c["ok"] for c in checks), "problems": problems, "episodes": len(sound), "open": waiting}
    return counts | {"uncompared": len(uncompared), "checks": checks, "meeting": medians}


def _judge(jobs: Iterable[Job], crew: Crew, bar: "tqdm[Any]") -> Iterator[Judged]:
    """Everything judged, in the order of the jobs; one that takes two workers with it is a problem of its own."""
    wanted = list(jobs)
    order, done = [job.name for job in wanted], dict[str, Judged]()
    # the recipe's order goes from cell to cell; a worker holds the ledger of one task and robot
    queue = deque(sorted(wanted, key=lambda job: group_of(job.slot) if job.slot else ("", "")))
    shared = dict[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...]]()
    if not order:
        return
    bar.total += len(order)
    bar.refresh()
    # the calls are of slots, or of directories
    seconds = EPISODE_SECONDS if queue[0].slot else DIRECTORY_SECONDS
    with closing(run(judge, queue, crew, seconds)) as ends:
        for end in ends:
            match end:
                case Done(job, judged):
                    # most slots have the same counts
                    done[job.name] = replace(judged, looked=shared.setdefault(judged.looked, judged.looked))
                case Died(job, reason):
                    why = f"{job.name}: {reason.replace('_', ' ')} twice while reading it; remove it and run the build again"
                    slot = job.slot or next(job.recipe.slots())
                    done[job.name] = Judged(slot, [Finding("readable", why)], damaged=job.slot is not None).brief()
            bar.update(1)
    yield from (done[name] for name in order)


def _hindrance(
    dataset: Dataset, found: Iterable[tuple[Slot, SlotState]], recorded: Collection[Slot], judged: Sequence[Judged]
) -> str:
    """Why no export can be compared now; empty if it can."""
    sound = [each for each in judged if each.sound]
    there = [
        state.accepted if state.accepted is not None else slot in recorded or os.path.lexists(dataset.episode(slot))
        for slot, state in found
    ]
    if sum(there) > len(sound):
        return f"not compared while {sum(there) - len(sound)} episodes are damaged"
    if not sound:
        return "not compared while there are no episodes"
    damaged = any(each.problem and each.check.startswith("annotations") for of in judged for each in of.findings)
    return "not compared while annotations are damaged" if damaged else ""


def judge() -> Callable[[Job], Judged]:
    """The work of a worker, which keeps a part of the ledger in memory."""
    ledgers = dict[str, Lookup]()

    def work(job: Job) -> Judged:
        if job.root not in ledgers:
            ledgers[job.root] = Lookup(Dataset(Path(job.root)).ledger)
        return judge_one(job, ledgers[job.root]).brief()

    return work


def judge_one(job: Job, ledger: Lookup) -> Judged:
    """What is wrong with a slot, or with a directory of annotations or of an export."""
    dataset = Dataset(Path(job.root))
    if job.slot is None:
        place = dataset.root / job.directory
        if place.parent.name == "exports":
            found = check_export(dataset, place, [Path(e) for e in job.episodes])
        else:
            found = check_stage(dataset, place, {dataset.episode(slot) for slot in job.recipe.slots()})
        return Judged(next(job.recipe.slots()), list(found))
    record, findings = layout.check_entry(dataset, job.recipe, job.slot, ledger)
    if record is None or not record.accepted:
        return Judged(job.slot, findings)
    judged, there = judge_episode(dataset, job.recipe, job.slot, record), os.path.lexists(dataset.episode(job.slot))
    judged = judge_images(judged, dataset, job.recipe, record, job.draw)
    if not any((dataset.root / name).is_dir() for name in ("annotations", "exports")):  # they are compared with the episodes
        free_space(dataset.episode(job.slot))
    return replace(judged, findings=findings + judged.findings, damaged=there and not judged.sound)


def _medians(judged: Iterable[Judged]) -> dict[str, dict[str, float]]:
    """Medians of the meetings by task."""
    meetings: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for each in judged:
        if each.meeting is not None:
            meetings[each.slot.cell.task].append(each.meeting)
    return {
        task: {
            "median_abs_seconds": float(np.median([abs(t) for t, _ in pairs])),
            "median_metres": float(np.median([d for _, d in pairs])),
            "worst_seconds": float(max((t for t, _ in pairs), key=abs)),
        }
        for task, pairs in meetings.items()
    }


def _summarise_meetings(tally: Tally, medians: dict[str, dict[str, float]]) -> None:
    for task, m in medians.items():
        close = m["median_abs_seconds"] <= CONTACT_SECONDS and m["median_metres"] <= CONTACT_METRES
        said = f"{task} {1000 * m['median_abs_seconds']:.0f} ms {1000 * m['median_metres']:.1f} mm"
        tally.add([Finding("meeting", "" if close else f"{task}: first contact is off by a median of {said}")])
        check = tally["meeting"]
        check.note = f"{check.note}, {said}" if check.note else f"medians: {said}"


def condemn(dataset: Dataset, recipe: Recipe, bad: Collection[Slot], sound: Collection[Slot], assets: Iterable[Path]) -> str:
    """Give the ledger entries of damaged episodes the stamp DAMAGED, take it from sound ones, and give damaged assets another time.

    Returns why that cannot be done; empty if it was, or nothing is to be done. What is on an object store is not written.
    """
    entries = dataset.entries(recipe, ("stamp",))
    stamps = zip(entries.slots, entries.table["stamp"].to_pylist(), strict=True)
    said = {slot for slot, stamp in stamps if stamp == DAMAGED}
    changed = dict.fromkeys(set(bad) - said, DAMAGED) | dict.fromkeys(said & set(sound), "")
    touched = [path for path in assets if os.path.lexists(path)]
    if not (changed or touched):
        return ""
    if mirror_of(dataset.root) is not None:
        return "not noted for the build: the dataset is on a store"
    try:
        with exclusive(dataset.root):
            ledger = Lookup(dataset.ledger)
            found = [(slot, record) for slot in sorted(changed) if (record := ledger.record(slot.path)) and record.accepted]
            if found:
                dataset.ledger.add((slot, replace(old, file=replace(old.file, stamp=changed[slot]))) for slot, old in found)
            for path in touched:
                os.utime(path)
    except Busy:
        return "not noted for the build: another command is writing the dataset"
    except OSError as error:
        return f"not noted for the build: {error.strerror or error}"
    return ""
