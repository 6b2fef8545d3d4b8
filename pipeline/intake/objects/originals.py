"""`assets: robotwin:DIR`: the original's objects in place of our families.

Each instance becomes an object's directory in the user's cache, by the content of its files.
"""

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from pipeline.data.atomic import write_atomic
from pipeline.data.keys import digest, file_hash
from pipeline.data.process.limited import LimitError, Limits, run_limited
from pipeline.data.process.machine import user_cache
from pipeline.data.recipe.model import RecipeError
from pipeline.plugins import use_plugins
from pipeline.world.meshes.part import MeshError
from pipeline.world.objects.from_files import TOML, ObjectError, add_all

from .draft import ObjectOptions, write_object
from .robotwin import VERSION, Instance, described_in, draft_of_instance, instances
from .standing import instance_of

SCHEME = "robotwin:"
REFUSED = "refused.txt"
# objects that are made in one child process, and seconds of processor time for each
BATCH, SECONDS = 12, 120
NO_GRASP = "no grasp: it is too wide for two fingers, or there is no room for a hand"


class OriginalModel(NamedTuple):
    """A directory of RoboTwin-OD and its used instances, by default all; `held` ones need a
    grasp."""

    directory: str
    ids: tuple[int, ...]
    held: bool
    scale: float


with Path(__file__).with_name("originals.csv").open(newline="") as _file:
    MODELS: Mapping[str, OriginalModel] = {
        row["key"]: OriginalModel(
            *(row["directory"], tuple(map(int, row["ids"].split()))),
            *(row["held"] == "yes", float(row["scale"])),
        )
        for row in csv.DictReader(_file)
    }
"""The original's models by family, or by `task.family`. Its cabinet and its kitchen pot are
articulated, and ours take their places."""


@dataclass(frozen=True)
class _OriginalInstance:
    key: str
    family: str
    model: OriginalModel
    files: Instance

    @property
    def name(self) -> str:
        return f"{self.family}_{self.model.directory[:3]}_{self.files.at}"


@dataclass(frozen=True)
class Found:
    """Objects by recipe key, and lines on unusable instances."""

    assets: str
    objects: Mapping[str, tuple[str, ...]]
    ungraspable: tuple[str, ...]
    unreadable: tuple[str, ...]


def provide(assets: str, tasks: Mapping[str, frozenset[str]]) -> Found:
    """Add the original's objects for these tasks. Raises RecipeError."""
    root, cache = _root(assets), user_cache("robotwin")
    if cache is None:
        raise RecipeError("assets: there is no home for the cache: set DOMINO_DATA_CACHE")
    instances = [each for key in sorted(_keys(tasks)) for each in _instances(root, key)]
    if not instances:
        raise RecipeError(
            f"assets: {root} holds no object for these tasks; name RoboTwin's assets/objects"
        )
    objects, places = dict[str, tuple[str, ...]](), dict[str, Path]()
    ungraspable, unreadable = dict[str, str](), dict[str, str]()
    made = {each.name: _place_of(each, cache / "items") for each in instances}
    missing = [(each, made[each.name]) for each in instances if not _is_made(made[each.name])]
    unmade = dict[str, str]()
    starts = range(0, len(missing), BATCH)
    for k in tqdm(starts, desc="objects of RoboTwin-OD", disable=None, leave=False):
        unmade |= _make(missing[k : k + BATCH])
    for each in instances:
        place = made[each.name]
        if (place / TOML).is_file():
            objects[each.key] = (*objects.get(each.key, ()), each.name)
            places[each.name] = place
            continue
        why = unmade.get(each.name) or (place / REFUSED).read_text()
        refused = ungraspable if why == NO_GRASP else unreadable
        refused[each.name] = f"{each.model.directory} {each.files.at}: {why}"
    pairs = [[name, str(place)] for name, place in sorted(places.items())]
    plugins = cache / "sets" / digest(pairs)
    (plugins / "objects").mkdir(parents=True, exist_ok=True)
    for name, place in places.items():
        _link(plugins / "objects" / name, place)
    add_all(plugins / "objects")
    use_plugins([str(plugins)])
    refusals = tuple(ungraspable.values()), tuple(unreadable.values())
    return Found(f"{SCHEME}{root.absolute()}", objects, *refusals)


def _root(assets: str) -> Path:
    given = Path(assets.removeprefix(SCHEME))
    for root in (given / "assets" / "objects", given / "objects", given):
        if root.is_dir():
            return root
    raise RecipeError(f"assets: {given}: is no directory; name assets/objects of RoboTwin")


def _keys(tasks: Mapping[str, frozenset[str]]) -> Iterator[str]:
    for task, families in tasks.items():
        for family in families:
            yield from [key for key in (f"{task}.{family}", family) if key in MODELS][:1]


def _instances(root: Path, key: str) -> Iterator[_OriginalInstance]:
    model = MODELS[key]
    for each in instances(root / model.directory):
        if not model.ids or each.at in model.ids:
            yield _OriginalInstance(key, key.rpartition(".")[2], model, each)


def _place_of(instance: _OriginalInstance, cache: Path) -> Path:
    files, words = instance.files, described_in(instance.files)
    read = [files.visual, files.solid, files.data, *([words] if words else [])]
    hashes = [file_hash(path) for path in read]
    content = digest([VERSION, instance.family, instance.model.scale, hashes])
    return cache / content / instance.name


def _is_made(place: Path) -> bool:
    return (place / TOML).is_file() or (place / REFUSED).is_file()


def _make(batch: Sequence[tuple[_OriginalInstance, Path]]) -> dict[str, str]:
    limits = Limits(processor=SECONDS * len(batch), wall=3.0 * SECONDS * len(batch))
    try:
        run_limited(str(batch[0][0].files.visual), _make_here, batch, limits=limits)
    except LimitError as error:
        if len(batch) == 1:
            return {batch[0][0].name: str(error)}
        return _make(batch[: len(batch) // 2]) | _make(batch[len(batch) // 2 :])
    return {}


def _make_here(batch: Sequence[tuple[_OriginalInstance, Path]]) -> None:
    for instance, place in batch:
        if _is_made(place):
            continue
        options, model = ObjectOptions(instance.name, instance.family, place.parent), instance.model
        try:
            draft = draft_of_instance(instance.files, options, model.scale)
            usual = instance_of(instance.family).frames().grasps if model.held else ()
            if usual and not draft.settings.grasps:
                raise ObjectError(NO_GRASP)
        except (ObjectError, MeshError) as error:
            write_atomic(place / REFUSED, str(error).encode())
        else:
            write_object(draft, place)


def _link(link: Path, place: Path) -> None:
    temporary = link.with_name(f".{link.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(place.absolute(), target_is_directory=True)
    temporary.replace(link)
