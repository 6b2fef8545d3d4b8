"""From a rollout or episode file to new images or sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import View
from pipeline.data.clock import PHYSICS_HZ, at_rate
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import Episode, EpisodeFile
from pipeline.data.episode.frames import encode_frames
from pipeline.data.episode.meta import Drawing, EpisodeMeta, ObjectInfo
from pipeline.data.episode.state_log import StateLog, physics_id
from pipeline.data.episode.writer import write_episode
from pipeline.data.keys import SlotKeys, file_hash
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.records import FileFacts, SlotRecord, untimed
from pipeline.data.store.place import place_of
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import TRACKS, Interception, physics_arrays
from pipeline.poses import Floats32
from pipeline.report.page import failed_folder
from pipeline.run.compile_ahead import ensure_compiled
from pipeline.stages.attempt import Rollout
from pipeline.stages.drawing.render import Appearance, appearance_of, capture, keep
from pipeline.stages.drawing.tracks import track_arrays
from pipeline.stages.scene import Scene, build_scene
from pipeline.stages.surroundings import table_drop
from pipeline.tasks.language.sentences import instructions
from pipeline.world.drawing.renderer import is_software


def episode_of(rollout: Rollout, recipe: Recipe, drawing: Drawing, keys: SlotKeys) -> Episode:
    """The accepted rollout as an episode, without images."""
    scene, task, log = rollout.scene, rollout.scene.task, rollout.replay.log
    after = scene.by_role(log)[0].choices
    objects = dict[str, ObjectInfo]()
    for name, body in scene.bodies.items():
        words, values = body.instance.words(), vars(body.instance).items()
        objects[name] = ObjectInfo(
            family=body.family,
            noun=words.noun,
            description=words.seen[0],
            parameters={k: v for k, v in values if isinstance(v, int | float | str)},
        )
    workspace = task.workspace
    meta = EpisodeMeta(
        fps=recipe.fps,
        target=task.target,
        manipulated=task.manipulated,
        category=task.category,
        arms=scene.arms,
        choices=scene.choices,
        choices_after=after if after != scene.choices else {},
        objects=objects,
        clutter=scene.clutter,
        clutter_wanted=scene.rules.clutter,
        objects_wanted=dict(scene.rules.objects),
        table_drop=table_drop(scene.spec),
        meeting_time=rollout.meeting,
        **asdict(rollout.motion.features()),
        rules=scene.rules.name,
        contact=scene.rules.after_touch(task.category),
        layout=scene.rules.layout,
        drive=scene.rules.drive,
        events=scene.events,
        **rollout.demonstrator.describe(),
        physics_hz=PHYSICS_HZ,
        step_limit=at_rate(task.step_limit, recipe.fps),
        workspace=(workspace.x_min, workspace.x_max, workspace.y_min, workspace.y_max),
        drawing=drawing,
        physics_id=physics_id(scene.spec, log),
        **keys.header(),
    )
    derived = Interception(meta, log, rollout.motion)
    return Episode(
        scene.spec,
        log,
        rollout.motion.to_json(),
        sentences(scene, log, recipe.instructions),
        meta,
        interception=physics_arrays(derived, scene.condition_history(log)),
    )


def sentences(scene: Scene, log: StateLog, count: int) -> dict[str, list[str]]:
    """`count` seen and unseen instructions for a scene, from its own stream, and as many for what
    an event of the log made of it."""
    spoken = instructions(scene.wording(), scene.spec.rng("language"), count)
    asked = scene.by_role(log)[0]
    if asked is not scene:
        later = instructions(asked.wording(), scene.spec.rng("language"), count)
        spoken |= {f"{split}_after": texts for split, texts in later.items()}
    return spoken


@dataclass(eq=False)
class Images:
    """How an episode was drawn, its views, JPEG frames (T,), point clouds, and `tracks` by key
    of `interception`.
    """

    drawing: Drawing
    views: list[View]
    coded: list[NDArray[np.bytes_]]
    pointcloud: Floats32 | None = None
    tracks: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])


def draw(dataset: Dataset, scene: Scene, log: StateLog, recipe: Recipe) -> Images:
    """Render and encode an episode, and keep what it is drawn from. Raises OSError."""
    appearance = appearance_of(scene, recipe)
    drawing = keep(appearance, AssetStore(dataset.bodies))
    objects = [name for name in scene.bodies if name not in scene.clutter]
    return images_of(appearance, drawing, objects, log, recipe)


def images_of(
    appearance: Appearance, drawing: Drawing, objects: Sequence[str], log: StateLog, recipe: Recipe
) -> Images:
    """Render a log with the recipe's sensors, encode the frames, and track `objects`."""
    tracks = track_arrays(appearance, log.late(drawing.latency), objects)
    if is_software(recipe.render):
        ensure_compiled()
    captured = capture(appearance, log, recipe)
    coded = [encode_frames(view.rgb) for view in captured.views]
    return Images(drawing, captured.views, coded, captured.pointcloud, tracks)


def stored_images(file: EpisodeFile) -> Images:
    """The images of an episode file as they are, frames still encoded."""
    views, coded = list[View](), list[NDArray[Any]]()
    for name, info in file.meta.drawing.cameras.items():
        group = f"observation/{name}"
        poses = file.array(f"{group}/pose")
        none = np.empty((0, info.height, info.width, 3), np.uint8)
        depth, mask = file.optional(f"{group}/depth"), file.optional(f"{group}/actor_segmentation")
        views.append(View(info.camera(name), poses, none, depth, mask))
        coded.append(file.array(f"{group}/rgb"))
    tracks = {key: values for key, values in file.interception().items() if key.startswith(TRACKS)}
    return Images(file.meta.drawing, views, coded, file.optional("pointcloud"), tracks)


def write(path: Path, episode: Episode, images: Images) -> tuple[str, FileFacts]:
    """Write an episode file; its sha256, and what the index holds of it."""
    own = {key: v for key, v in episode.interception.items() if not key.startswith(TRACKS)}
    tracked = replace(episode, interception=own | dict(images.tracks))
    write_episode(path, tracked, images.views, images.coded, images.pointcloud)
    meta, assets = episode.meta, list(episode.meta.drawing.assets.values())
    facts = FileFacts.of(path.stat(), len(episode.log), meta.physics_id, assets)
    return file_hash(path), facts


def renew(
    dataset: Dataset, recipe: Recipe, slot: Slot, old_entry: SlotRecord, keys: SlotKeys
) -> SlotRecord:
    """Make images or sentences of a stored episode again, to the bytes of a new build. Raises
    EpisodeError.
    """
    with EpisodeFile(dataset.episode(slot)) as file:
        old, images = file.read(), stored_images(file)
    scene = build_scene(old.spec, recipe.ruling()).furnished(motion_from_json(old.motion))
    # with the same keys, an asset is missing
    if old_entry.keys.render != keys.render or old_entry.keys.language == keys.language:
        images = draw(dataset, scene, old.log, recipe)
    meta = old.meta.model_copy(update={"drawing": images.drawing, **keys.header()})
    # version 0.1 stored no attempts in its episodes
    spoken, tried = sentences(scene, old.log, recipe.instructions), untimed(old_entry.attempts)
    episode = replace(old, instructions=spoken, meta=meta, attempts=tried)
    sha, facts = write(dataset.episode(slot), episode, images)
    return replace(old_entry, keys=keys, sha256=sha, file=facts)


def send_slot(dataset: Dataset, slot: Slot, record: SlotRecord) -> None:
    """Put a slot's files to the store, if any; the episode does not stay here. Raises
    StoreError.
    """
    place = place_of(dataset.root)
    if place is None:
        return
    assets, path = AssetStore(dataset.bodies), dataset.episode(slot)
    kept = [dataset.failure(slot, row["attempt"]) for row in record.attempts if row.get("kept")]
    drawn = assets.root.glob("*/*.npz") if kept else map(assets.path, record.file.assets)
    place.put(path for path in drawn if path.exists())  # another worker may have put it
    failed = failed_folder(dataset.root, slot.cell.path).glob(f"*-{slot.index}-*.jpg")
    place.put(path for path in (*kept, *failed, dataset.log(slot)) if path.exists())
    if record.accepted:
        place.put([path])
        path.unlink()
        place.delete([dataset.file(slot, False)])
    else:
        place.delete([path])
