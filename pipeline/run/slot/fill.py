"""One slot: attempts until one is accepted, images, file."""

import faulthandler
import os
import sys
import time
import traceback
from collections import deque
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.crew.contract import CrewError, Died, Steps, result_of
from pipeline.data.atomic import remove
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError
from pipeline.data.episode.visuals import LOOK
from pipeline.data.keys import SlotKeys, is_intact
from pipeline.data.process.machine import trim
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.records import SlotRecord, untimed
from pipeline.data.store.place import place_of
from pipeline.run.identity.core import code_version
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.state import IMAGES, SENTENCES, SlotState
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.tracks import require_view
from pipeline.stages.failure import Failure
from pipeline.stages.replay import Demonstrator, expert_of
from pipeline.world.drawing.renderer import device_of

from .failures import Failed, keep_failure, keep_last_frames, remove_failures
from .make import draw, episode_of, renew, send_slot, write

RENEWAL = -1
"""Stands for the number of an attempt when only images or sentences are made."""


@dataclass(frozen=True)
class LostAttempt:
    """An attempt (or RENEWAL) that took two workers with it; `seconds` are the second's."""

    attempt: int
    reason: str
    seconds: float


@dataclass(frozen=True)
class FillJob:
    """What a worker is sent.

    `renewing` is the record of an episode of which only images or sentences are made. `lost`
    attempts are recorded as failed; if RENEWAL is among them, the episode is made from nothing.
    `code` is the driver's version."""

    root: str
    recipe: Recipe
    slot: Slot
    renewing: SlotRecord | None = None
    lost: tuple[LostAttempt, ...] = ()

    def without(self, died: Died["FillJob"]) -> "FillJob":
        """The job without the fatal attempt. Raises CrewError if none is left to blame."""
        attempt = died.trying
        if not isinstance(attempt, int):
            # they died before they began: on the first attempt that they would have made
            lost = {one.attempt for one in self.lost}
            attempt = next((n for n in range(self.recipe.attempts) if n not in lost), None)
            if attempt is None:
                raise CrewError(f"{self.slot.path}: workers die of it before they try any seed")
        return replace(self, lost=(*self.lost, LostAttempt(attempt, died.reason, died.seconds)))


def check_node(root: str, code: str, preset: str, look: int = LOOK) -> dict[str, str]:
    """Check that a worker's machine reaches the dataset and runs this code; what all machines
    share. Raises DatasetError, StoreError, NoRenderer.
    """
    manifest = Dataset(Path(root)).manifest
    place = place_of(manifest)
    if not (place.store.read(place.name(manifest)) if place else manifest.exists()):
        raise DatasetError(
            f"{root} is not there: --out must be where all nodes of the cluster reach it"
        )
    if code != (own := code_version()):
        raise DatasetError(
            f"runs code {own}, the driver {code}: install the same version on all nodes"
        )
    return {"renderer": device_of(preset, look)}


def demonstrator_of(recipe: Recipe) -> Demonstrator:
    """The recipe's expert, or a policy that the expert corrects."""
    if recipe.corrections is None:
        return expert_of(recipe)
    from pipeline.evaluate.correct import Correction  # policies take a second to import

    return Correction(recipe)


def slot_jobs(dataset: Dataset, recipe: Recipe, todo: Mapping[Slot, SlotState]) -> deque[FillJob]:
    """What the workers are sent to make what is missing of some slots, in their order."""
    renewed = {slot for slot, state in todo.items() if state.todo in (IMAGES, SENTENCES)}
    records = dict[Slot, SlotRecord]()
    # a failed attempt that is kept is only made with its slot
    if renewed and recipe.keep_failures == "none":
        records = {slot: record for slot, record in dataset.records(recipe) if slot in renewed}
    root = str(dataset.root.resolve())
    return deque(FillJob(root, recipe, slot, records.get(slot)) for slot in todo)


class Log:
    """A log that is being written; it is removed in the end unless it is to be kept."""

    keep = False


@contextmanager
def worker_log(path: Path) -> Iterator[Log]:
    """Append standard output, error and tracebacks (also of fatal signals) to a file. Raises
    OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    log = Log()
    with open(path, "a", encoding="utf-8", buffering=1) as file:
        print(end="", flush=True)
        kept = [(number, os.dup(number)) for number in (1, 2)]
        crashes = faulthandler.is_enabled()
        faulthandler.enable(file)
        try:
            for number, _ in kept:
                os.dup2(file.fileno(), number)
            # Ray's workers print to files that are not the process's own
            with redirect_stdout(file), redirect_stderr(file):
                yield log
        except Exception as error:
            log.keep = True
            traceback.print_exc(file=file)
            error.add_note(f"log of its worker: {path}")
            raise
        finally:
            print(end="", flush=True)
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
            faulthandler.disable()
            if crashes and sys.__stderr__ is not None:
                faulthandler.enable(sys.__stderr__)
    if not log.keep:
        path.unlink(missing_ok=True)
        with suppress(OSError):  # other slots have logs there
            path.parent.rmdir()


def fill_slot(job: FillJob) -> SlotRecord:
    """As `fill_in_steps`, in one."""
    return result_of(fill_in_steps(job))


def fill_in_steps(job: FillJob) -> Steps[SlotRecord]:
    """Make what is missing of a slot; yield each attempt's number first. Failed slots keep logs."""
    dataset = Dataset(Path(job.root))
    with worker_log(dataset.log(job.slot)) as log:
        print(f"{job.slot.path}, process {os.getpid()}")
        record = yield from _fill(dataset, job)
        log.keep = not record.accepted or bool(job.lost)
        for row in record.attempts:
            if row["reason"]:
                print(
                    f"attempt {row['attempt']}, seed {row['seed']}: {row['stage']}:"
                    f" {row['reason']}: {row['detail']}"
                )
    trim()
    send_slot(dataset, job.slot, record)
    return record


def _fill(dataset: Dataset, job: FillJob) -> Steps[SlotRecord]:
    keys = RecipeKeys(job.recipe).of(job.slot)
    path, old = dataset.episode(job.slot), job.renewing
    # what a worker that was killed, on whatever machine, has left half-written
    for left in path.parent.glob(f".{path.name}.*.tmp"):
        left.unlink(missing_ok=True)
    tried = any(one.attempt == RENEWAL for one in job.lost)
    # a worker that died may have written it already
    if old and not tried and is_intact(path, old.sha256):
        yield RENEWAL
        with suppress(EpisodeError, KeyError):  # a damaged file is made from nothing
            return renew(dataset, job.recipe, job.slot, old, keys)
    began, worked = time.perf_counter(), time.process_time()
    made = yield from _from_nothing(dataset, job, keys)
    wall, cores = time.perf_counter() - began, time.process_time() - worked
    return replace(made, seconds=wall, core_seconds=cores)


def _from_nothing(
    dataset: Dataset, job: FillJob, keys: SlotKeys
) -> Generator[int, None, SlotRecord]:
    recipe, slot = job.recipe, job.slot
    lost = {one.attempt: one for one in job.lost}
    rows = list[dict[str, Any]]()
    demonstrator = demonstrator_of(recipe)
    remove(dataset.episode(slot))
    if recipe.keep_failures != "none":
        remove_failures(dataset, slot)
    for number in range(recipe.attempts):
        spec, began = recipe.spec(slot, number), time.perf_counter()
        row: dict[str, Any] = asdict(slot.cell)
        row |= {"slot": slot.index, "attempt": number, "seed": spec.seed, "stage": "", "reason": ""}
        row |= {"detail": "", "conditions": []}
        if one := lost.get(number):
            row |= {"outcome": "failed", "stage": "worker", "reason": one.reason, "sim_steps": 0}
            rows.append(row | {"seconds": one.seconds})
            continue
        yield number
        try:
            rollout = attempt(spec, recipe, demonstrator)
            if recipe.view == "unoccluded":
                require_view(rollout, recipe)
        except Failure as failure:
            row |= {"outcome": "failed", "stage": failure.stage, "reason": failure.reason}
            row |= {"sim_steps": failure.steps, "detail": failure.detail}
            row |= {"conditions": list(failure.conditions)}
            row |= asdict(failure.drawn) if failure.drawn else {}
            seconds = time.perf_counter() - began
            keep_last_frames(dataset, recipe, slot, number, failure)
            failed = Failed(slot, number, failure, keys, demonstrator)
            if kept := keep_failure(dataset, recipe, failed):
                row["kept"] = kept
            rows.append({"seconds": seconds} | row)
            continue
        images = draw(dataset, rollout.scene, rollout.replay.log, recipe)
        row |= {"outcome": "accepted", "sim_steps": rollout.steps}
        row |= asdict(rollout.motion.features())
        episode = episode_of(rollout, recipe, images.drawing, keys)
        episode = replace(episode, attempts=untimed([*rows, row]))
        sha, facts = write(dataset.episode(slot), episode, images)
        rows.append({"seconds": time.perf_counter() - began} | row)
        dataset.file(slot, False).unlink(missing_ok=True)
        return SlotRecord(keys, True, sha, tuple(rows), file=facts)
    return write_given_up(dataset, slot, keys, rows)
