"""One slot judged by itself: its ledger entry and its episode file, whether both are what the recipe wants, its images."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.data.assets import AssetStore
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.jpeg import encode_frames
from pipeline.data.keys import Key, file_hash
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.names import sides_of
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.setup import camera_name
from pipeline.run.identity.slot_keys import redrawn_keys
from pipeline.run.slot.make import stored_images
from pipeline.run.slot.redraw import cached_parts
from pipeline.run.verify.arrays import check_arrays, check_images
from pipeline.run.verify.physics import CHECKS, Physics
from pipeline.run.verify.tally import FAULTS, Finding, count_checks, line, named, observe
from pipeline.stages.drawing.render import capture, stored_appearance
from pipeline.stages.failure import Failure

AGAIN = "run the build again"


@dataclass(frozen=True)
class Judged:
    """What was found of one slot: `looked` counts the observations of each check, where `findings` has only those with a problem.
    `meeting` is how late (s) and how far off (m) the first contact was; `assets` maps bodies to the
    hashes of what they were drawn from; `sound` says whether the file is the one that was written, `damaged` that one is there
    that is not; `uncompared` says why its images were to be rendered again and cannot be."""

    slot: Slot
    findings: list[Finding]
    sound: bool = False
    meeting: tuple[float, float] | None = None
    assets: dict[str, str] = field(default_factory=dict)
    looked: tuple[tuple[str, int], ...] = ()
    damaged: bool = False
    uncompared: str = ""

    def brief(self) -> "Judged":
        """The same with its observations counted: a dataset has a hundred for every slot, which fill the memory."""
        looked, problems = count_checks(self.findings)
        assets = {sys.intern(body): sys.intern(key) for body, key in self.assets.items()}
        return replace(self, findings=problems, looked=looked, assets=assets)


def judge_episode(dataset: Dataset, recipe: Recipe, slot: Slot, record: SlotRecord) -> Judged:
    """Run all checks of one slot whose ledger entry is accepted. Faults of the file are findings, never exceptions."""
    path = dataset.episode(slot)
    judged = _judge_path(path, recipe, slot, record, dataset.bodies)
    return replace(judged, findings=list(named(path.relative_to(dataset.root).as_posix(), judged.findings)))


def _judge_path(path: Path, recipe: Recipe, slot: Slot, record: SlotRecord, bodies: Path) -> Judged:
    if not path.exists():
        return Judged(slot, [Finding("files", f"is in the ledger and missing; {AGAIN}")])
    findings = [Finding("files")]
    try:
        same = file_hash(path) == record.sha256
    except OSError as error:
        return Judged(slot, [*findings, Finding("readable", f"cannot be read ({error.strerror}); {AGAIN}")])
    findings.append(observe("hashes", same, f"bytes differ from the ledger's sha256; {AGAIN}"))
    try:
        with EpisodeFile(path) as file:
            found = _judge_file(file, recipe, slot, record, bodies)
    except FAULTS as error:
        return Judged(slot, [*findings, Finding("readable", line(error, path))])
    return replace(found, findings=findings + found.findings, sound=same and found.sound)


def judge_images(judged: Judged, dataset: Dataset, recipe: Recipe, record: SlotRecord, count: int) -> Judged:
    """As judged, with `count` frames of every camera of a sound episode rendered again and compared."""
    if not (judged.sound and count):
        return judged
    if changed := record.keys.render.changed(redrawn_keys(recipe, judged.slot, record.keys).render):
        return replace(judged, uncompared=f"changed since: {', '.join(changed)}")
    name = dataset.episode(judged.slot).relative_to(dataset.root).as_posix()
    try:
        found = list(check_drawn(dataset, recipe, judged.slot, record, count))
    except FAULTS as error:
        found = [Finding("images", f"cannot be rendered again: {line(error)}")]
    return replace(judged, findings=[*judged.findings, *named(name, found)], sound=not any(finding.problem for finding in found))


def _judge_file(file: EpisodeFile, recipe: Recipe, slot: Slot, record: SlotRecord, bodies: Path) -> Judged:
    checks: list[tuple[str, Callable[[], Iterator[Finding]]]] = [
        ("content", lambda: check_content(file)),
        ("spec", lambda: check_spec(file, recipe, slot, record)),
        ("arrays", lambda: check_arrays(file)),
        ("jpeg", lambda: check_images(file)),
    ]
    findings = list[Finding]()
    physics: Physics | None = None
    try:
        poses = {camera: file.array(f"observation/{camera}/pose") for camera in file.meta.drawing.cameras}
        physics = Physics(file.read(), recipe, slot, record.keys, poses, bodies)
    except FAULTS as error:
        findings.append(Finding("readable", line(error, file.path)))
    else:
        findings.append(Finding("readable"))
        checks += [(kind, partial(check, physics)) for kind, check in CHECKS.items()]
    for kind, check in checks:
        try:
            findings += check()
        except (*FAULTS, Failure) as error:
            findings.append(Finding(kind, line(error, file.path)))
    if physics is None or any(finding.problem for finding in findings):
        return Judged(slot, findings)
    return Judged(slot, findings, True, physics.meeting(), dict(file.meta.drawing.assets))


def check_content(file: EpisodeFile) -> Iterator[Finding]:
    """Every dataset is the one that was written, by the hashes in the file."""
    damaged = file.damaged()
    said = f"{', '.join(damaged[:3])}{' and others' if len(damaged) > 3 else ''}"
    yield observe("content", not damaged, f"{said}: not what was written; {AGAIN}")


def check_spec(file: EpisodeFile, recipe: Recipe, slot: Slot, record: SlotRecord) -> Iterator[Finding]:
    """The episode is the one that the recipe wants at this place: spec, seed, variant, rate, cameras, sensors, keys."""
    spec, cell, meta = file.spec, slot.cell, file.meta
    got = (spec.task, spec.embodiment, spec.level, spec.alpha, spec.domain, spec.slot)
    wanted = (cell.task, cell.embodiment, cell.level, cell.alpha, cell.domain, slot.index)
    yield observe("spec", got == wanted, f"is the episode {_words(got)}, not {_words(wanted)}")
    seeds = [recipe.spec(slot.physical, number).seed for number in range(recipe.attempts)]
    tried = [row["seed"] for row in record.attempts if row["outcome"] == "accepted"] or seeds
    right = spec.seed in seeds and spec.seed in tried
    yield observe("spec", right, f"its seed {spec.seed} is not that of its accepted attempt")
    yield observe("variant", meta.variant == slot.variant, f"claims to be variant {meta.variant}")
    yield observe("recipe", meta.fps == recipe.fps, f"has {meta.fps} frames per second, the recipe {recipe.fps}")
    ruling = recipe.ruling()
    got, wanted = (meta.rules, meta.contact, meta.layout), (ruling.name, ruling.after_touch(meta.category), ruling.layout)
    yield observe("recipe", got == wanted, f"was judged by the rules {', '.join(got)}, the recipe has {', '.join(wanted)}")
    cameras = {camera_name(c) for c in recipe.cameras_on(sides_of(file.names("joint_state", "names")))}
    yield observe("recipe", set(file.cameras) == cameras, f"has cameras {', '.join(file.cameras)}, not {', '.join(cameras)}")
    for camera in cameras & set(file.cameras):
        for key, given in (("depth", recipe.depth), ("actor_segmentation", recipe.segmentation)):
            has = file.has(f"observation/{camera}/{key}")
            yield observe("recipe", has == given, f"{camera} has {'a' if has else 'no'} {key}, unlike the recipe")
    keys = (meta.physics_key, meta.render_key) == (record.keys.physics.digest, record.keys.render.digest)
    keys &= not meta.keys or meta.keys == record.keys.to_json()
    yield observe("keys", keys, "its keys are not those of its ledger entry")


def _words(values: tuple[object, ...]) -> str:
    task, embodiment, level, alpha, domain, index = values
    return f"{task}/{embodiment}/L{level}/alpha {alpha}/{domain}/{index}"


def other_device(dataset: Dataset, device: str) -> str:
    """Why nothing can be compared that `device` renders; empty if the dataset was rendered by the same kind of device.

    Two devices do not give the same pixels, and the keys of an episode do not name its device: provenance.json does.
    """
    try:
        made = dataset.made_by()
    except DatasetError:
        made = {}
    merged = made.get("merged_from", ())
    named = {str(each["renderer"]) for each in [made, *merged] if "renderer" in each} or {"an unknown device"}
    return "" if named == {device} else f"rendered by {', '.join(sorted(named))}, here by {device}"


def check_drawn(dataset: Dataset, recipe: Recipe, slot: Slot, record: SlotRecord, count: int) -> Iterator[Finding]:
    """`count` frames of every camera, and the depth, segmentation and point clouds stored with them, rendered again.

    Which frames follows from the episode's keys. Raises EpisodeError and AssetError for files that cannot be read.
    """
    with EpisodeFile(dataset.episode(slot)) as file:
        episode, stored = file.read(), stored_images(file)
    frames = sample_frames(record.keys.render, len(episode.log), count)
    appearance = stored_appearance(episode, AssetStore(dataset.bodies), cached_parts)
    made = capture(appearance, episode.log, recipe, frames)
    for view, old, coded in zip(made.views, stored.views, stored.coded, strict=True):
        for k, (frame, image) in enumerate(zip(frames, encode_frames(view.rgb), strict=True)):
            pairs = ((view.depth, old.depth), (view.segmentation, old.segmentation))
            same = coded[frame] == image
            same &= all(b is not None and np.array_equal(a[k], b[frame]) for a, b in pairs if a is not None)
            yield observe("images", same, f"{view.camera.name} image {frame} is not what its state log shows")
    if made.pointcloud is not None:
        same = stored.pointcloud is not None and np.array_equal(made.pointcloud, stored.pointcloud[frames])
        yield observe("images", same, "pointcloud is not what its state log shows")


def sample_frames(key: Key, frames: int, count: int) -> list[int]:
    """Which frames of an episode are rendered again: `count` of them in order, or all where it has no more."""
    chosen = np.random.default_rng(int(key.digest, 16)).permutation(frames)[:count]
    return sorted(chosen.tolist())
