"""`assets: robotwin:DIR`: the original's objects in place of our families, instance by instance as in its 35 tasks.

The directory is that of RoboTwin-OD, `assets/objects` of a checkout or a directory that holds it. Each instance becomes an object's
directory in the user's cache, once; what is cached is found again by the content of its files. The recipe names them as it names
objects from files, with a key `task.family` where a task of the original has instances of its own.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from pipeline.data.atomic import write_atomic
from pipeline.data.keys import digest, file_hash
from pipeline.data.recipe.model import RecipeError
from pipeline.data.store.user_cache import user_cache
from pipeline.run.objects.add import Options, write_object
from pipeline.run.objects.robotwin import VERSION, Instance, described_in, draft_of_instance, instances
from pipeline.run.objects.standing import first_of
from pipeline.run.plugins import use_plugins
from pipeline.world.objects.from_files import TOML, ObjectError, add_all

SCHEME = "robotwin:"
REFUSED = "refused.txt"
NO_GRASP = "no grasp: it is too wide for two fingers, or there is no room for a hand"


class Model(NamedTuple):
    """A directory of RoboTwin-OD and its instances that tasks use; all that there are if none are named.

    `held` is False for goals and for what is only pressed, which need no grasp. `scale` is that of files which give none.
    """

    directory: str
    ids: tuple[int, ...] = ()
    held: bool = True
    scale: float = 1.0


MODELS: Mapping[str, Model] = {
    "alarm_clock": Model("046_alarm-clock", (1, 3), held=False),
    "basket": Model("110_basket", (0, 1)),
    "bell": Model("050_bell", (0, 1)),
    "big_bin": Model("011_dustbin", (0,), held=False),
    "bottle": Model("001_bottle", tuple(range(20))),
    "bowl": Model("002_bowl", (1, 2, 3, 5)),
    "bread": Model("075_bread"),
    "bread_basket": Model("076_breadbasket", (0, 1, 2, 3, 4), held=False),
    "can": Model("071_can", (0, 1, 2, 3, 5, 6)),
    "coaster": Model("019_coaster", (0,), held=False),
    "coffee_box": Model("113_coffee-box"),
    "cup": Model("021_cup", tuple(range(8))),
    "display_stand": Model("074_displaystand", (0, 1, 2, 3, 4), held=False),
    "dustbin": Model("011_dustbin", (0,), held=False),
    "fan": Model("099_fan", (4, 5)),
    "hammer": Model("020_hammer", (0,)),
    "lying_bottle": Model("001_bottle", (13, 16)),
    "microphone": Model("018_microphone", (0, 4, 5)),
    "mouse": Model("047_mouse", (0, 1, 2)),
    "mug": Model("039_mug", tuple(range(10))),
    "phone": Model("077_phone", (0, 1, 2, 4)),
    "phone_stand": Model("078_phonestand", (1, 2), held=False),
    "pill_bottle": Model("080_pillbottle", (1, 2, 3, 4, 5)),
    "plate": Model("003_plate", (0,), held=False, scale=0.025),
    "playing_cards": Model("081_playingcards", (0, 1, 2)),
    "qr_sign": Model("070_paymentsign", (0, 1, 2, 3)),
    "rack": Model("040_rack", (0,), held=False),
    "remote": Model("079_remotecontrol"),
    "roller": Model("102_roller", (0, 2)),
    "rubiks_cube": Model("073_rubikscube"),
    "sauce_can": Model("105_sauce-can", (0, 2, 4, 5, 6)),
    "scale": Model("072_electronicscale", (0, 1, 5, 6), held=False),
    "scanner": Model("024_scanner", (0, 1, 2, 3, 4)),
    "seal": Model("100_seal", (0, 2, 3, 4, 6)),
    "shoe": Model("041_shoe", tuple(range(10))),
    "skillet": Model("106_skillet", (0, 1, 2, 3)),
    "soap": Model("107_soap"),
    "stapler": Model("048_stapler", tuple(range(7))),
    "table_bin": Model("063_tabletrashbin", (0, 3, 7, 8, 9, 10)),
    "tea_box": Model("112_tea-box", tuple(range(6))),
    "toy_car": Model("057_toycar", tuple(range(6))),
    "wooden_block": Model("086_woodenblock"),
}
"""The original's models by the family that they stand for. Blocks, pads and mats are boxes there, too; its cabinet and its
kitchen pot are articulated, and ours take their places."""

OF_TASKS: Mapping[str, Model] = {
    "place_bread_basket.bread": Model("075_bread", (0, 1, 3, 5, 6)),
    "place_bread_skillet.bread": Model("075_bread", (0, 1, 3, 5, 6)),
    "place_container_plate.cup": Model("021_cup", tuple(range(1, 8))),
    "place_empty_cup.cup": Model("021_cup", (0,)),
    "put_bottles_dustbin.bottle": Model("114_bottle", (1, 2, 3)),
}
"""Models of single tasks, where they differ."""


@dataclass(frozen=True)
class _Wanted:
    """An instance that is to stand for a family, under a key of `objects`."""

    key: str
    family: str
    model: Model
    files: Instance

    @property
    def name(self) -> str:
        """Its name as an object: the family, and the number of the model and of the instance."""
        return f"{self.family}_{self.model.directory[:3]}_{self.files.number or 0}"


@dataclass(frozen=True)
class Found:
    """Where they are, and the objects by key of a recipe's `objects`. A line names each instance that no hand can grasp, or that
    cannot be read."""

    assets: str
    objects: Mapping[str, tuple[str, ...]]
    ungraspable: tuple[str, ...]
    unreadable: tuple[str, ...]


def provide(assets: str, tasks: Mapping[str, frozenset[str]]) -> Found:
    """Add the original's objects for the families of these tasks (families by task), for this process and those that it starts.

    Raises RecipeError if the directory holds none of them, or if nothing can be cached.
    """
    root, cache = _root(assets), user_cache("robotwin")
    if cache is None:
        raise RecipeError("assets: objects are kept in the user's cache, and there is no home: set DOMINO_DATA_CACHE")
    wanted = [each for key in sorted(_keys(tasks)) for each in _instances(root, key)]
    if not wanted:
        raise RecipeError(f"assets: {root} holds no object for these tasks; name the directory assets/objects of RoboTwin")
    objects, places = dict[str, list[str]](), dict[str, Path]()
    ungraspable, unreadable = dict[str, str](), dict[str, str]()
    for each in tqdm(wanted, desc="objects of RoboTwin-OD", disable=None, leave=False):
        place = _make_object(each, cache / "items")
        if (place / TOML).is_file():
            objects.setdefault(each.key, []).append(each.name)
            places[each.name] = place
        else:
            why = (place / REFUSED).read_text()
            refused = ungraspable if why == NO_GRASP else unreadable
            refused[each.name] = f"{each.model.directory} {each.files.number or 0}: {why}"
    plugins = cache / "sets" / digest([[name, str(place)] for name, place in sorted(places.items())])
    (plugins / "objects").mkdir(parents=True, exist_ok=True)
    for name, place in places.items():
        _link(plugins / "objects" / name, place)
    add_all(plugins / "objects")
    use_plugins([str(plugins)])
    found = {key: tuple(names) for key, names in objects.items()}
    return Found(f"{SCHEME}{root.absolute()}", found, tuple(ungraspable.values()), tuple(unreadable.values()))


def _root(assets: str) -> Path:
    given = Path(assets.removeprefix(SCHEME))
    for root in (given / "assets" / "objects", given / "objects", given):
        if root.is_dir():
            return root
    raise RecipeError(f"assets: {given}: is no directory; name the directory assets/objects of RoboTwin")


def _keys(tasks: Mapping[str, frozenset[str]]) -> Iterator[str]:
    """The keys of `objects` that these tasks use."""
    for task, families in tasks.items():
        for family in families:
            own = f"{task}.{family}"
            if own in OF_TASKS:
                yield own
            elif family in MODELS:
                yield family


def _instances(root: Path, key: str) -> Iterator[_Wanted]:
    model = OF_TASKS.get(key) or MODELS[key]
    found = sorted(instances(root / model.directory), key=lambda each: int(each.number or 0))
    for each in found:
        if not model.ids or int(each.number or 0) in model.ids:
            yield _Wanted(key, key.rpartition(".")[2], model, each)


def _make_object(wanted: _Wanted, cache: Path) -> Path:
    """The directory of an instance as an object, or one that states why it is none."""
    files, words = wanted.files, described_in(wanted.files)
    read = [files.visual, files.solid, files.data, *([words] if words else [])]
    place = cache / digest([VERSION, wanted.family, wanted.model.scale, [file_hash(path) for path in read]]) / wanted.name
    if (place / TOML).is_file() or (place / REFUSED).is_file():
        return place
    options = Options(wanted.name, wanted.family, place.parent)
    try:
        draft = draft_of_instance(files, options, wanted.model.scale)
        if wanted.model.held and first_of(wanted.family).frames().grasps and not draft.settings.grasps:
            raise ObjectError(NO_GRASP)
    except ObjectError as error:
        write_atomic(place / REFUSED, str(error).encode())
    else:
        write_object(draft, place)
    return place


def _link(link: Path, place: Path) -> None:
    """Make a link, which another process may make at the same time."""
    temporary = link.with_name(f".{link.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(place.absolute(), target_is_directory=True)
    temporary.replace(link)
