"""Finds the tasks, robots, motions and objects that a recipe names."""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

import numpy as np

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.events import EXCHANGES
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.errors import DominoError
from pipeline.data.parsing import show_value
from pipeline.data.recipe.model import Recipe, RecipeError, check_size, parse_recipe
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Corrections, Sight
from pipeline.intake.own_tasks import check_task
from pipeline.motion.models import MODELS, levels_of
from pipeline.stages.surroundings import CLUTTER_FAMILIES
from pipeline.tasks import TASKS
from pipeline.tasks.contract import DOMINO, expand_tasks, suites
from pipeline.tasks.layout import (
    admits_instruction,
    admits_swap,
    bodies_of,
    can_do,
    families_of,
    goals_of,
)
from pipeline.world.cameras import CameraError, check_links
from pipeline.world.objects.contract import FAMILIES, stands_for
from pipeline.world.robots import MODELS as ROBOTS
from pipeline.world.robots import UnknownEmbodiment, get_embodiment


def recipe_from(
    values: Mapping[str, Any], source: str = "recipe", flags: Mapping[str, str] | None = None
) -> Recipe:
    """A checked and resolved recipe from keys or options (`flags`)."""
    return resolve(parse_recipe(values, source, flags), source, flags)


def resolve(
    recipe: Recipe, source: str = "recipe", flags: Mapping[str, str] | None = None
) -> Recipe:
    """The recipe with suites, `all` and robot aliases resolved. Raises RecipeError."""

    def where(key: str) -> str:
        return (flags or {}).get(key) or f"{source}: {key}:"

    tasks = expand_tasks(recipe.tasks)
    check_known("task", tasks, TASKS, f"{source}: ")
    try:
        embodiments = tuple(dict.fromkeys(get_embodiment(e).name for e in recipe.embodiments))
        recipe = recipe.model_copy(update={"tasks": tasks, "embodiments": embodiments})
        _check_links(recipe)
    except (UnknownEmbodiment, CameraError) as error:
        raise RecipeError(f"{source}: {error}") from error
    for task in tasks:
        check_task(TASKS[task])
    _check_motions(recipe, where)
    for name in embodiments:
        if beyond := [
            task for task in tasks if not can_do(TASKS[task], get_embodiment(name).sides)
        ]:
            raise RecipeError(
                f"{where('embodiments')} {name} has no arm for {', '.join(beyond)}: leave these"
                " tasks out, or use two arms"
            )
    check_size(recipe, source)
    recipe = with_originals(recipe)
    objects = _check_objects(recipe, where("objects"))
    _check_reactive(recipe, where)
    try:
        corrections = named_policy(recipe.corrections) if recipe.corrections else None
    except DominoError as error:
        raise RecipeError(str(error).replace("--policy", where("corrections"), 1)) from error
    return recipe.model_copy(update={"corrections": corrections, "objects": objects})


def check_known(kind: str, names: Iterable[str], known: Collection[str], where: str = "") -> None:
    """Raise RecipeError for an unknown task or family, with close names."""
    for name in names:
        if name not in known:
            near = ", ".join(get_close_matches(name, known, 3))
            raise RecipeError(
                f"{where}no {kind} {show_value(name)}{near and f', but {near}'};"
                f" `domino-data {kind.split()[0]}s` lists them"
            )


def named_policy(corrections: Corrections) -> Corrections:
    """The same with the label of its policy as it is now. Raises PolicyError."""
    from pipeline.evaluate.names import policy_name  # policies take a second to import

    name = policy_name(corrections.policy)
    return Corrections(policy=name.text, label=name.label)


class Untrusted(DatasetError):
    """A dataset names a policy that nobody has agreed to run."""


def check_trust(corrections: Corrections | Mapping[str, Any] | None, source: str) -> None:
    """Raise Untrusted for `corrections` by another's policy."""
    if corrections is None:
        return
    from pipeline.evaluate.names import is_ours  # policies take a second to import

    policy: Any = corrections
    if isinstance(corrections, Corrections):
        policy = corrections.policy
    elif isinstance(corrections, Mapping):
        policy = corrections.get("policy")
    if not is_ours(str(policy)):
        raise Untrusted(
            f"{source}: its recipe runs {show_value(policy)} (corrections), the code of whoever"
            " made the dataset: read it, then add --trust"
        )


def _check_reactive(recipe: Recipe, where: Callable[[str], str]) -> None:
    """Raise RecipeError for what expert or corrections need."""
    for key in ("perturb", "takeover"):
        if recipe.corrections is None and getattr(recipe, key) != Recipe.model_fields[key].default:
            raise RecipeError(f"{where(key)} needs a policy to correct: add corrections")
    if recipe.reactive is None and recipe.sight != Sight():
        raise RecipeError(f"{where('sight')} needs the reactive expert: add expert")


def _check_motions(recipe: Recipe, where: Callable[[str], str]) -> None:
    """Raise RecipeError for an unknown motion model or a level it does not have."""
    if recipe.motion is not None and recipe.motion not in MODELS:
        known = ", ".join(MODELS)
        raise RecipeError(
            f"{where('motion')} no motion {show_value(recipe.motion)}; choose from {known}"
        )
    for model in dict.fromkeys(recipe.motion or TASKS[task].motion for task in recipe.tasks):
        known = levels_of(model)
        if unknown := [level for level in recipe.levels if level not in known]:
            has = ", ".join(map(str, known))
            raise RecipeError(f"{where('levels')} {unknown[0]} is unknown; {model} has {has}")


def drawn_families(recipe: Recipe) -> dict[str, frozenset[str]]:
    """The object families of layouts by task; "" for distractors."""
    families = {task: families_of(TASKS[task]) for task in recipe.tasks}
    return families | ({"": frozenset(CLUTTER_FAMILIES)} if "randomized" in recipe.domains else {})


def with_originals(recipe: Recipe) -> Recipe:
    """The recipe with the original's objects of its `assets`; those of its `objects` stay. Raises
    RecipeError for one that cannot be read, which with the whole suite `domino` is only named."""
    if recipe.assets is None:
        return recipe
    originals = _provide(recipe, recipe.assets)
    notes = [f"not used: {note}" for note in originals.ungraspable]
    if unreadable := originals.unreadable:
        if not set(suites()[DOMINO]) <= set(recipe.tasks):
            raise RecipeError(
                f"assets: {unreadable[0]}: repair it, or move its model_data file away to build"
                " without it"
            )
        count, each = len(unreadable), "; ".join(unreadable)
        notes.append(f"objects left out because they cannot be read: {count}: {each}")
    for note in notes:
        print(f"domino-data: assets: {note}", file=sys.stderr)
    objects = {**originals.objects, **recipe.objects}
    return recipe.model_copy(update={"assets": originals.assets, "objects": objects})


def add_originals(recipe: Recipe) -> None:
    """Add the original's objects that a stored recipe names. Raises RecipeError."""
    if (
        recipe.assets is not None
        and _named(recipe) - set(FAMILIES)
        and set(recipe.tasks) <= set(TASKS)
    ):
        _provide(recipe, recipe.assets)


def _provide(recipe: Recipe, assets: str) -> Any:
    from pipeline.intake.objects.originals import provide  # trimesh takes a second

    return provide(assets, drawn_families(recipe))


def _named(recipe: Recipe) -> set[str]:
    return {name for names in recipe.objects.values() for name in names}


def installed_recipe(dataset: Dataset) -> Recipe:
    """The frozen recipe with the original's objects. Raises DatasetError for missing names,
    RecipeError.
    """
    recipe = dataset.recipe()
    add_originals(recipe)
    needed = (
        ("task", set(recipe.tasks), TASKS),
        ("motion", {recipe.motion} if recipe.motion else set[str](), MODELS),
        ("object", _named(recipe), FAMILIES),
        ("robot", set(recipe.robots()), ROBOTS),
    )
    for kind, names, known in needed:
        if missing := sorted(names - set(known)):
            raise DatasetError(
                f"{dataset.root} needs the {kind} {missing[0]!r}, which is not installed: give"
                " --plugins with its directory"
            )
    return recipe


def check_events(setup: Setup, tasks: Iterable[str], evaluated: bool = False) -> None:
    """Raise RecipeError for an event that cannot act in these tasks."""
    kinds = set[str]().union(*(event.kinds for event in setup.events))
    if "latency" in kinds and not evaluated:
        raise RecipeError(
            "events: latency slows down the answers of a policy, which a build does not ask: leave"
            " it out"
        )
    cameras = setup.camera_names
    for camera in (camera for event in setup.events for camera in event.cameras):
        if camera not in cameras:
            known = ", ".join(cameras) or "none"
            raise RecipeError(f"events: there is no camera {show_value(camera)}; cameras: {known}")
    needs = {
        "goal": (goals_of, "moves a body that is neither target nor handled"),
        "instruction": (admits_instruction, "asks for another moving body by its name"),
        "swap": (admits_swap, "exchanges a target in which nothing lies"),
    }
    for kind in sorted(kinds & needs.keys()):
        admits, what = needs[kind]
        if lacking := [task for task in tasks if not admits(TASKS[task])]:
            fits = [name for name in TASKS if kind == "instruction" and admits(TASKS[name])]
            fix = f"choose from {', '.join(fits)}" if fits else "leave the event or the task out"
            raise RecipeError(f"events: {kind} {what}, which {lacking[0]} does not have: {fix}")
    if kinds & EXCHANGES and isinstance(setup, Recipe) and setup.corrections:
        raise RecipeError(
            f"events: {sorted(kinds & EXCHANGES)[0]} and corrections exclude each other"
        )


def _check_objects(recipe: Recipe, where: str) -> dict[str, tuple[str, ...]]:
    """The objects that stand for families, by their full names: `mug` also means mug_0 and so on.
    Raises RecipeError for one that does not exist or fit, and for a family that no task draws."""
    objects = dict[str, tuple[str, ...]]()
    drawn = drawn_families(recipe) if recipe.objects else {}
    ours = [name for name, family in FAMILIES.items() if stands_for(family) is None]
    for key, names in recipe.objects.items():
        task, _, family = key.rpartition(".")
        check_known("object family", [family], ours, f"{where} ")
        check_known("task", [task] if task else [], TASKS, f"{where} ")
        theirs = families_of(TASKS[task]) if task else frozenset[str]().union(*drawn.values())
        if family not in theirs:
            raise RecipeError(
                f"{where} no task of the recipe draws a {family}; they draw"
                f" {', '.join(sorted(theirs))}"
            )
        objects[key] = tuple(
            dict.fromkeys(full for name in names for full in _instances(name, family, where))
        )
        frames = _frames(family)
        for name in objects[key]:
            if missing := frames - _frames(name):
                raise RecipeError(
                    f"{where} {name} has no frame {', '.join(sorted(missing))}; add it to its"
                    " object.toml"
                )
    return objects


def _frames(family: str) -> set[str]:
    return set(FAMILIES[family].draw(np.random.default_rng(0)).frames().points)


def _instances(name: str, family: str, where: str) -> list[str]:
    """The objects from files of a name. Raises RecipeError for none."""
    numbered = re.compile(rf"{re.escape(name)}(_[0-9]+)?")
    families = {each: of for each in FAMILIES if (of := stands_for(FAMILIES[each]))}
    known = [each for each in families if numbered.fullmatch(each)]
    if not known:
        ours = ", ".join(each for each, of in families.items() if of == family)
        fix = f"those of {family} are {ours}" if ours else "add it with `domino-data objects add`"
        raise RecipeError(f"{where} no object {show_value(name)}; {fix}")
    for each in known:
        if families[each] != family:
            raise RecipeError(
                f"{where} {each} stands for {families[each]}, not for {family}; change family in"
                " its object.toml"
            )
    return known


def _check_links(recipe: Recipe) -> None:
    """Raise CameraError for a camera on a link that neither robot nor task has."""
    named = [c.camera(c.name) for c in recipe.cameras if isinstance(c, NamedCamera)]
    for name in recipe.embodiments if named else ():
        arms = get_embodiment(name).arms.items()
        links = [f"{side}_{link.name}" for side, arm in arms for link in arm.links]
        for task in recipe.tasks:
            check_links(named, [*bodies_of(TASKS[task]), *links, "table"])
