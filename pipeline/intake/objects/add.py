"""`domino-data objects add`."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.data.names import is_name
from pipeline.data.process.limited import run_limited
from pipeline.plugins import load_plugins
from pipeline.world.objects import from_files
from pipeline.world.objects.contract import FAMILIES, directory_of
from pipeline.world.objects.from_files import ObjectError, add_directory

from .draft import ObjectDraft, ObjectOptions, draft_of, write_object
from .holding import WIDEST
from .robotwin import drafts_of_directory, is_robotwin
from .standing import bounds


class AddedObject(NamedTuple):
    directory: Path
    notes: tuple[str, ...]


def add_objects(source: Path, options: ObjectOptions) -> list[AddedObject]:
    """Read objects in a limited child process and add them. Raises DominoError before writing."""
    check_names(options)
    if not source.is_dir():
        check_free([options.name], options.to)
    drafts = run_limited(str(source), draft_all, source, options)
    return enter_objects(drafts, options.to)


def enter_objects(drafts: Mapping[str, ObjectDraft], to: Path) -> list[AddedObject]:
    check_free(drafts, to)
    for name, draft in drafts.items():
        write_object(draft, to / "objects" / name)
        add_directory((to / "objects" / name).resolve())
    return [AddedObject(to / "objects" / name, draft.notes) for name, draft in drafts.items()]


def draft_all(source: Path, options: ObjectOptions) -> dict[str, ObjectDraft]:
    load_plugins()  # the family may be one of theirs
    if is_robotwin(source):
        return drafts_of_directory(source, options)
    if source.is_dir():
        raise ObjectError(f"{source}: is a directory; name the mesh file in it")
    return {options.name: draft_of(source, options)}


def check_free(names: Iterable[str], to: Path) -> None:
    for name in names:
        if (place := to / "objects" / name / from_files.TOML).exists():
            raise ObjectError(f"{place.parent}: exists; remove it first, or choose another --name")
        if name in FAMILIES:
            raise ObjectError(f"--name {name}: an object or family of this name exists already")


def check_names(options: ObjectOptions) -> None:
    name, family = options.name, options.family
    if not is_name(name) or name != name.lower():
        raise ObjectError(f"--name {name!r}: is no name; use lower case and underscores")
    if family not in FAMILIES or directory_of(FAMILIES[family]) is not None:
        ours = ", ".join(each for each, kind in FAMILIES.items() if directory_of(kind) is None)
        raise ObjectError(f"--family {family}: no such family; choose from {ours}")


def describe(added: AddedObject) -> Iterator[str]:
    directory, name, plugins = added.directory, added.directory.name, added.directory.parents[1]
    yield from (f"note: {note}" for note in added.notes)
    files = directory_of(FAMILIES[name])
    settings, solid = files.settings, files.solid
    size = " x ".join(f"{100 * edge:.1f}" for edge in np.ptp(bounds(solid), axis=0))
    kinds = Counter(kind for kind, _, _ in settings.grasps)
    counted = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    weight = f"{size} cm, {settings.mass:g} kg, {len(solid)} convex pieces"
    yield f"wrote {directory}: {weight}, grasps: {counted or 'none'}"
    if not counted:
        narrow = f"nothing is narrower than {1000 * WIDEST:.0f} mm"
        yield f"{narrow}: try another --up, or use it as a goal"
    yield f"look at it with: domino-data check-object {name} --plugins {plugins} --images out"
    yield f"use it with: --plugins {plugins} --objects {settings.family}={name}"
