"""An object is a directory: `object.toml`, `looks.glb` (drawn), `solid.obj` (convex collision
pieces). It stands for a family."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import AfterValidator, Field
from scipy.spatial import ConvexHull, QhullError

from pipeline.data.errors import DominoError
from pipeline.data.names import is_name
from pipeline.data.parsing import LARGEST_FILE
from pipeline.data.reading import read_regular
from pipeline.poses import IDENTITY, Floats
from pipeline.world.files import Table, read_glb, read_toml
from pipeline.world.shapes import Collider, Parts, Shape

from .contract import FAMILIES, Family, Grasp, NamedFrames, Words, directory_of, register

TOML, LOOKS, SOLID = "object.toml", "looks.glb", "solid.obj"
FRICTION = 0.6
MOST_PIECES, MOST_CORNERS = 64, 64


class ObjectError(DominoError):
    """An object's directory or mesh is unusable."""


def _unit(values: tuple[float, ...]) -> tuple[float, ...]:
    if abs(np.linalg.norm(values[3:]) - 1) > 1e-3 or not np.all(np.abs(values[:3]) < 2):
        raise ValueError("is no pose x y z qw qx qy qz with a unit quaternion within 2 m")
    return values


type PoseRow = Annotated[
    tuple[float, float, float, float, float, float, float], AfterValidator(_unit)
]


class Phrases(Table):
    noun: Annotated[str, Field(min_length=1, max_length=80)]
    seen: Annotated[tuple[str, ...], Field(min_length=1)]
    unseen: Annotated[tuple[str, ...], Field(min_length=1)]


class ObjectToml(Table):
    """The settings of `object.toml`. Mass in kg; frames are x y z qw qx qy qz in the object's frame
    (m). A grasp is its kind, its width (m) and the tcp."""

    family: str
    source: str = ""
    licence: str = "unknown"
    mass: Annotated[float, Field(gt=0, le=50)]
    friction: Annotated[float, Field(gt=0, le=2)] = FRICTION
    words: Phrases
    frames: dict[str, PoseRow]
    grasps: tuple[tuple[str, Annotated[float, Field(gt=0, lt=0.5)], PoseRow], ...] = ()


class Directory:
    """An object's files, read on demand. Raises ObjectError and GlbError."""

    def __init__(self, path: Path) -> None:
        self.path, self.settings = path, read_settings(path)

    @cached_property
    def solid(self) -> tuple[Collider, ...]:
        return read_solid(self.path / SOLID)

    @cached_property
    def looks(self) -> Parts:
        return read_glb(self.path / LOOKS)


@dataclass(frozen=True)
class FileObject(Family):
    """Every draw is this one object."""

    directory: ClassVar[Directory]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        return cls()

    def shape(self) -> Shape:
        files = self.directory
        return Shape(tuple(files.looks), files.solid, files.settings.mass, files.settings.friction)

    def frames(self) -> NamedFrames:
        settings = self.directory.settings
        points = {name: np.array(row) for name, row in settings.frames.items()}
        grasps = (Grasp(np.array(row), width, kind) for kind, width, row in settings.grasps)
        return NamedFrames(points, tuple(grasps))

    def words(self) -> Words:
        words = self.directory.settings.words
        return Words(words.noun, words.seen, words.unseen)

    def __reduce__(self) -> tuple[type["_Named"], tuple[str]]:
        return _Named, (self.directory.path.name,)


class _Named:
    """What a pickled object is read as."""

    def __new__(cls, name: str) -> Family:  # pyright: ignore[reportIncompatibleMethodOverride, reportInconsistentConstructor]
        return FAMILIES[name]()


def add_directory(path: Path) -> None:
    """Register an object by its directory's name. Raises ObjectError."""
    if path.name in FAMILIES:
        known = directory_of(FAMILIES[path.name])
        if known is not None and known.path == path:
            return
        wrong = f"another object or family is called {path.name!r}; rename the directory"
        raise ObjectError(f"{path / TOML}: {wrong}")
    if not is_name(path.name):
        wrong = f"{path.name!r} is no name of an object; use lower case and underscores"
        raise ObjectError(f"{path / TOML}: {wrong}")
    directory = Directory(path)
    if (family := directory.settings.family) not in FAMILIES:
        wrong = f"no object family {family!r}; `domino-data objects` lists them"
        raise ObjectError(f"{path / TOML}: family: {wrong}")
    body = {"directory": directory, "__module__": __name__}
    register(path.name)(type(path.name, (FileObject,), body))


def add_all(folder: Path) -> None:
    """Register a folder's objects by name order. Raises ObjectError."""
    for path in sorted(folder.glob(f"*/{TOML}")):
        add_directory(path.parent)


def read_settings(path: Path) -> ObjectToml:
    """Read the settings of an object's directory. Raises ObjectError."""
    file = path / TOML
    settings = read_toml(file, ObjectToml, ObjectError)
    if missing := {"base", "top"} - settings.frames.keys():
        raise ObjectError(f"{file}: frames: has no {' and no '.join(sorted(missing))}")
    return settings


def read_solid(file: Path) -> tuple[Collider, ...]:
    """Convex pieces, an `o` line each. Raises ObjectError."""
    groups: list[list[list[float]]] = []
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise ValueError(f"is larger than {LARGEST_FILE} bytes")
        for line in read_regular(file).decode().splitlines():
            word, *values = line.split() or [""]
            if word == "o":
                groups.append([])
            elif word == "v":
                groups[-1].append([float(value) for value in values])
        if not 0 < len(groups) <= MOST_PIECES or max(map(len, groups)) > MOST_CORNERS:
            most = f"{MOST_PIECES} pieces of {MOST_CORNERS} corners at most"
            raise ValueError(f"has {len(groups)} pieces; {most}, and one at least")
        return tuple(piece(np.array(points)) for points in groups)
    except (OSError, ValueError, IndexError, QhullError) as error:
        why = " ".join(str(error).split())[:120]
        raise ObjectError(f"{file}: not readable as collision pieces ({why})") from error


def piece(points: Floats) -> Collider:
    """Hull of points (N,3) m. Raises ValueError and QhullError."""
    if not np.isfinite(points).all():
        raise ValueError("a corner is not finite")
    return Collider("convex", (), IDENTITY, points, measured=float(ConvexHull(points).volume))
