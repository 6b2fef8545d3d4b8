"""The keys of a slot: what can change its physics, its images (`render`) and its sentences
(`language`). Each later key includes `physics`.
"""

from contextlib import suppress

from pipeline.data.keys import Key, SlotKeys, digest
from pipeline.data.recipe.model import CHOOSING, Recipe, RecipeError, Slot
from pipeline.data.setup import IMAGES
from pipeline.data.setup.rules import Rules
from pipeline.run.names import add_originals

from . import code, core


class RecipeKeys:
    """The keys of a recipe's slots with the present code and packages."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe, self._root = recipe, core.package_root()
        self._placed: dict[tuple[str, bool], dict[str, str]] = {}
        if recipe.assets is not None:
            with suppress(RecipeError):  # slots whose objects are missing have no keys
                add_originals(recipe)
        # a frozen recipe has all values written out; without defaults, a key which a later version
        # adds changes nothing
        given = recipe.model_dump(mode="json", exclude=set(CHOOSING), exclude_defaults=True)
        # objects count by content
        every = {name: value for name, value in given.items() if name not in (*IMAGES, "objects")}
        if recipe.corrections:
            every["corrections"] = recipe.corrections.label  # wherever the policy is
        spoken = {"instructions": every.pop("instructions", None)}
        self._physics, self._language = digest(every), digest(spoken)
        for name, key in zip(("textures", "environment"), recipe.brought, strict=True):
            given |= {name: key} if name in given else {}
        self._drawn = {name: given[name] for name in (*IMAGES, "camera") if name in given}
        if recipe.visuals != "randomized":
            self._drawn.pop("visual_seed", None)

    def of(self, slot: Slot) -> SlotKeys:
        """The keys of a slot. Raises UnknownName for a task that the code does not have."""
        cell, root = slot.cell, self._root
        randomized = cell.domain == "randomized"
        parts = code.cell_code(root, cell.task, cell.embodiment, randomized, self._recipe.motion)
        own = {"slot": digest([slot.physical.path, cell.alpha]), "recipe": self._physics}
        acting = {"policy": code.evaluation_code(root)} if self._recipe.corrections else {}
        # what bodies look like decides which attempts are accepted
        if self._recipe.view == "unoccluded":
            acting["view"] = digest([code.drawing_code(root), parts.looks])
        looks = parts.looks
        if self._recipe.objects and (files := self._objects(cell.task, randomized)):
            looks = digest([looks, files["looks"]])
            acting["files"] = files["physics"]
        physics = Key(own | parts.physics | acting)
        language = Key({"physics": physics.digest, "recipe": self._language, **parts.language})
        return SlotKeys(physics, self._render(slot, physics, looks), language)

    def redrawn(self, slot: Slot, source: SlotKeys) -> SlotKeys:
        """The keys of a slot that is drawn again from an episode with the keys `source`."""
        looks = source.render.parts["looks"]
        return SlotKeys(source.physics, self._render(slot, source.physics, looks), source.language)

    def _objects(self, task: str, randomized: bool) -> dict[str, str]:
        """Contents of the objects from files for a task; may be empty."""
        if (task, randomized) not in self._placed:
            rules = Rules(objects=tuple(sorted(self._recipe.objects.items())))
            self._placed[task, randomized] = code.object_contents(task, randomized, rules)
        return self._placed[task, randomized]

    def _render(self, slot: Slot, physics: Key, looks: str) -> Key:
        drawn = self._drawn | ({"variant": slot.variant} if slot.variant else {})
        made = {"physics": physics.digest, "recipe": digest(drawn), "looks": looks}
        return Key(made | code.drawing_code(self._root))


def slot_keys(recipe: Recipe, slot: Slot) -> SlotKeys:
    """The keys of one slot; for many, RecipeKeys. Raises UnknownName."""
    return RecipeKeys(recipe).of(slot)


def redrawn_keys(recipe: Recipe, slot: Slot, source: SlotKeys) -> SlotKeys:
    """As RecipeKeys.redrawn."""
    return RecipeKeys(recipe).redrawn(slot, source)


def code_version() -> str:
    """One hash of everything that can change any slot."""
    return code.code_version(core.package_root())


def policy_version() -> str:
    """A hash of the code by which policies act, without the policies."""
    return code.evaluation_code(core.package_root())
