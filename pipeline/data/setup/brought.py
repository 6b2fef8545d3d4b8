"""Images and light that a user brings for the room."""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, Strict, real
from pipeline.data.process.limited import Limits, run_limited
from pipeline.data.reading import read_regular
from pipeline.poses import Floats32, Pixels

KINDS = {"table": 0.6, "wall": 3.0, "floor": 1.5}
"""Folders of textures, and metres that an image covers unless its name tells (`oak@0.8.jpg`)."""

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
TEXELS = 512

Textures = dict[str, tuple[tuple[Pixels, float], ...]]
"""Textures (512,512,4) and the metres each covers, by kind."""

MOST_BYTES, MOST_FILES = 2**26, 1000
LIMITS = Limits(memory=1 << 30)  # an image of 256 million pixels has 768 MB


class BroughtError(DominoError, ValueError):
    """Images or light that cannot be used: one line with the file."""


class Brought(Strict):
    """A directory of textures or a file of light: absolute path, sha256 of its content, licence."""

    path: Annotated[str, Field(min_length=1, max_length=4096)]
    content: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    licence: Annotated[str, Field(max_length=200)] = "not stated"


def bring_textures(text: str) -> Brought:
    """The textures below a directory, read in a limited child process. Raises BroughtError."""
    root = Path(text).absolute()
    return _bring(hash_textures, root, root)


def bring_light(text: str) -> Brought:
    """The light in a file, read as textures are."""
    path = Path(text).absolute()
    return _bring(hash_light, path, path.parent)


def _bring(content: Callable[[Path], str], path: Path, folder: Path) -> Brought:
    """What is at a path, with the first line of a LICENSE file in `folder`."""
    try:
        found = run_limited(str(path), content, path, limits=LIMITS)
    except DominoError as error:
        raise BroughtError(str(error)) from error
    files = (file for file in sorted(folder.glob("LICEN[CS]E*")) if file.is_file())
    texts = (file.read_text(errors="replace") for file in files)
    lines = (line.strip()[:200] for text in texts for line in text.splitlines())
    licence = next(filter(None, lines), "not stated")
    return Brought(path=str(path), content=found, licence=licence)


def hash_textures(root: Path) -> str:
    return _read_textures(root)[0]


def hash_light(path: Path) -> str:
    return _read_light(path)[0]


def textures_of(brought: Brought) -> Textures:
    """The textures of a recipe. Raises BroughtError, also if they have changed."""
    return read_unchanged(_read_textures, brought.path, brought.content)


def light_of(brought: Brought) -> Floats32:
    """Equirectangular radiance (H,W,3). Raises as `textures_of`."""
    return read_unchanged(_read_light, brought.path, brought.content)


@lru_cache(maxsize=4)
def read_unchanged(read: Callable[[Path], tuple[str, Any]], path: str, content: str) -> Any:
    found, value = read(Path(path))
    if found != content:
        raise BroughtError(f"{path}: has changed since the recipe was made: restore it")
    return value


def _read_textures(root: Path) -> tuple[str, Textures]:
    files = {
        kind: sorted(p for p in (root / kind).glob("*") if p.suffix.lower() in SUFFIXES)
        for kind in KINDS
    }
    if not 0 < sum(map(len, files.values())) <= MOST_FILES:
        folders = ", ".join(f"{kind}/" for kind in KINDS)
        images = f"1 to {MOST_FILES} images ({', '.join(SUFFIXES)}) into {folders}"
        raise BroughtError(f"{root}: is no directory of textures: put {images}")
    total, found = hashlib.sha256(), Textures()
    for kind, paths in files.items():
        images = list[tuple[Pixels, float]]()
        for path in paths:
            data = _bytes(path)
            line = f"{kind}/{path.name}/{hashlib.sha256(data).hexdigest()}\n"
            total.update(line.encode(errors="surrogateescape"))
            image = _decode(path, data, cv2.IMREAD_COLOR)
            if image is None:
                raise BroughtError(f"{path}: is no image that can be read: replace or remove it")
            small = cv2.resize(image, (TEXELS, TEXELS), interpolation=cv2.INTER_AREA)
            # a texture begins at the foot of its tile
            upright = cv2.cvtColor(small, cv2.COLOR_BGR2RGBA)[::-1]
            images.append((np.asarray(upright.copy(), np.uint8), _metres(path, kind)))
        if images:
            found[kind] = tuple(images)
    return total.hexdigest(), found


def _metres(path: Path, kind: str) -> float:
    _, at, text = path.stem.rpartition("@")
    if not at:
        return KINDS[kind]
    try:
        return real(text, 0.01, 100)
    except ParseError as error:
        what = "after the @ of its name come the metres that it covers, 0.01 to 100"
        raise BroughtError(f"{path}: {what}") from error


def _read_light(path: Path) -> tuple[str, Floats32]:
    if path.suffix.lower() != ".hdr":
        raise BroughtError(f"{path}: is no .hdr file (Radiance, equirectangular): convert it")
    data = _bytes(path)
    radiance = _decode(path, data, cv2.IMREAD_UNCHANGED)
    floats = radiance is not None and radiance.dtype == np.float32 and radiance.ndim == 3
    if radiance is None or not floats or not np.isfinite(radiance).all() or radiance.max() <= 0:
        raise BroughtError(f"{path}: holds no light that can be read: replace it")
    height, width = radiance.shape[:2]
    if width != 2 * height:
        raise BroughtError(f"{path}: is {width}x{height}; make it twice as wide as high")
    return hashlib.sha256(data).hexdigest(), np.asarray(radiance[..., ::-1], np.float32)


def _decode(path: Path, data: bytes, how: int) -> NDArray | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), how) if data else None
    except cv2.error as error:
        raise BroughtError(f"{path}: needs too much memory: make it smaller") from error


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BroughtError(f"{path}: is larger than {MOST_BYTES >> 20} MiB")
        return read_regular(path)
    except OSError as error:
        raise BroughtError(f"{path}: cannot be read ({error.strerror})") from error
