"""The keys of a slot: what can change its physics, its images and its sentences.

`physics`: the slot, the recipe's parameters, and the code's part of it; for corrections of a policy, its label and the code by
which policies act. `render`, on top of it: preset, cameras, sensors, visuals, and what draws and gives things their look.
`language`, on top of the physics: the code's part of it. What the code decides comes from run/identity/code_parts.py, which imports
every task, robot and object, or from what that found before (run/identity/code_memo.py).
"""

from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.data.keys import Key, SlotKeys, digest
from pipeline.data.recipe.model import CHOOSING, Recipe, RecipeError, Slot
from pipeline.data.setup import IMAGES
from pipeline.run.identity import sources
from pipeline.run.identity.code_memo import recall

FOR_SENTENCES = ("instructions",)
CORRECTING = ("pipeline.evaluate.correct",)


class RecipeKeys:
    """The keys that the slots of a recipe have with the code and the packages as they are now."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe, self._root = recipe, sources.package_root()
        if recipe.assets is not None:
            from pipeline.run.names import add_originals  # a second: it imports every task

            with suppress(RecipeError):  # slots whose objects are missing have no keys, which readers report
                add_originals(recipe)
        # a frozen recipe has all values written out; without defaults, a key which a later version adds changes nothing
        given = recipe.model_dump(mode="json", exclude=set(CHOOSING), exclude_defaults=True)
        every = {name: value for name, value in given.items() if name not in (*IMAGES, "objects")}  # objects count by content
        if recipe.corrections:
            every["corrections"] = recipe.corrections.label  # wherever the policy is
        spoken = {name: every.pop(name, None) for name in FOR_SENTENCES}
        self._physics, self._language = digest(every), digest(spoken)
        textures, light = recipe.brought
        given |= {name: key for name, key in (("textures", textures), ("environment", light)) if name in given}
        self._drawn = {name: given[name] for name in (*IMAGES, "camera") if name in given}
        if recipe.visuals != "randomized":
            self._drawn.pop("visual_seed", None)

    def of(self, slot: Slot) -> SlotKeys:
        """The keys of a slot. Raises UnknownName for a task that the code does not have."""
        cell = slot.cell
        code = _slot_parts(self._root, cell.task, cell.embodiment, cell.domain == "randomized", self._recipe.motion)
        own = digest([slot.physical.path, cell.alpha])
        acting = {"policy": _policy_part(self._root)} if self._recipe.corrections else {}
        files = self._objects(cell.task, cell.domain == "randomized")
        looks = digest([code["looks"], files["looks"]]) if files else code["looks"]
        placed = {"files": files["physics"]} if files else {}
        physics = Key({"slot": own, "recipe": self._physics, **code["physics"], **acting, **placed})
        language = Key({"physics": physics.digest, "recipe": self._language, **code["language"]})
        return SlotKeys(physics, self._render(slot, physics, looks), language)

    def redrawn(self, slot: Slot, source: SlotKeys) -> SlotKeys:
        """The keys of a slot that is drawn again from an episode with the keys `source`: those that a build would give it, where
        what its physics and its looks were made from is still the same."""
        return SlotKeys(source.physics, self._render(slot, source.physics, source.render.parts["looks"]), source.language)

    def _objects(self, task: str, randomized: bool) -> dict[str, str]:
        """What the objects from files that may stand for families of a task hold; empty if there are none."""
        wanted = tuple(sorted(self._recipe.objects.items()))
        return _code_parts().object_parts(self._root, task, randomized, wanted) if wanted else {}

    def _render(self, slot: Slot, physics: Key, looks: str) -> Key:
        drawn = self._drawn | ({"variant": slot.variant} if slot.variant else {})
        return Key({"physics": physics.digest, "recipe": digest(drawn), "looks": looks, **_drawing_parts(self._root)})


def slot_keys(recipe: Recipe, slot: Slot) -> SlotKeys:
    """The keys of one slot; for many, RecipeKeys. Raises UnknownName for a task that the code does not have."""
    return RecipeKeys(recipe).of(slot)


def redrawn_keys(recipe: Recipe, slot: Slot, source: SlotKeys) -> SlotKeys:
    """As RecipeKeys.redrawn."""
    return RecipeKeys(recipe).redrawn(slot, source)


def code_version() -> str:
    """One hash of everything that can change any slot: for provenance, and to see that all workers run the same code."""
    return _code_version(sources.package_root())


def policy_version() -> str:
    """A hash of the code by which policies act and are corrected, without that of the policies."""
    return _policy_part(sources.package_root())


@cache
def _code_version(root: Path) -> str:
    return recall(root, ["code version"], lambda: _code_parts().code_version(root))


@cache
def _slot_parts(root: Path, task: str, embodiment: str, randomized: bool, motion: str | None) -> dict[str, Any]:
    asked = (task, embodiment, randomized)
    return recall(root, ["slot parts", *asked, motion or ""], lambda: _code_parts().slot_parts(root, *asked, motion))


@cache
def _policy_part(root: Path) -> str:
    return recall(root, ["policy part"], lambda: sources.sources_hash(root, sources.closure(root, CORRECTING)))


@cache
def _drawing_parts(root: Path) -> dict[str, str]:
    return recall(root, ["drawing parts"], lambda: _code_parts().drawing_parts(root))


def _code_parts():
    # a second: it imports every task
    from pipeline.run.identity import code_parts

    return code_parts
