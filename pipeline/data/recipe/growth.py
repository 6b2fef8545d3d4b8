"""Whether a dataset may grow from one recipe to another."""

from collections.abc import Mapping
from typing import Any

from pipeline.data.setup import IMAGES, option_of

from .model import CHOOSING, Recipe

_LISTS = ("tasks", "embodiments", "levels", "domains", "alpha")


def differences(held: Recipe, wanted: Recipe, phrase: str = "{} is {} there, not {}") -> list[str]:
    """One phrase for each key that changes what is held; image-only ones name `render`."""
    given = ("objects",) if held.assets and wanted.assets else ()
    # a policy is known by its label
    out = {**dict.fromkeys((*CHOOSING, *given), True), "corrections": {"policy"}}
    values, others = (recipe.model_dump(mode="json", exclude=out) for recipe in (held, wanted))
    changed = [key for key in values if values[key] != others[key]]
    phrases = [
        phrase.format(key, _show_key(held, values, key), _show_key(wanted, others, key))
        for key in changed
    ]
    if changed and set(changed) <= set(IMAGES):
        options = " ".join(f"{option_of(key)} ..." for key in changed)
        phrases.append(f"`domino-data render DATASET {options} --out NEW` draws its episodes so")
    return phrases


def _show_key(recipe: Recipe, values: Mapping[str, Any], key: str) -> str:
    if key == "contact" and recipe.contact is None:
        return f"what the rules say ({recipe.ruling().after_touch('tracking')})"
    if key == "events":  # without the keys that an event does not give
        given = (e.model_dump(mode="json", exclude_defaults=True) for e in recipe.events)
        return ", ".join(map(str, given)) or "none"
    return repr(values[key])


def left_out(held: Recipe, wanted: Recipe) -> list[str]:
    """One phrase for each key by which slots that are held would be left out."""
    phrases, before, after = list[str](), held.counts(), wanted.counts()
    lacking = [cell for cell, count in before.items() if count and cell not in after]
    for key in _LISTS if lacking else ():
        if missing := [value for value in getattr(held, key) if value not in getattr(wanted, key)]:
            shown = (f"{v:g}" if isinstance(v, float) else str(v) for v in missing)
            phrases.append(f"{key} {', '.join(shown)}")
    if fewer := {count for cell, count in before.items() if after.get(cell, count) < count}:
        phrases.append(f"{max(fewer)} episodes a cell")
    if held.variants > wanted.variants:
        phrases.append(f"{held.variants} variants")
    return phrases
