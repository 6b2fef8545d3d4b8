"""Files that a user's mesh or URDF names: found below one folder or in a package, or refused."""

import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from lxml import etree

from pipeline.data.reading import read_regular
from pipeline.poses import Pixels

from .part import MeshError

LFS_POINTER = b"version https://git-lfs"
MAX_BYTES = 256_000_000
MAX_NAME = 500  # characters of a file name
MAX_TRIANGLES = 500_000  # of one file: a link or an object is drawn with 2000 at most
TEXTURE = 512  # pixels of a kept texture's longer edge at most


def read_bytes(path: Path) -> bytes:
    """The bytes of a file. Raises MeshError, also for a pointer of Git LFS."""
    try:
        if (size := path.stat().st_size) > MAX_BYTES:
            raise MeshError(f"{path}: has {size} bytes; a file has at most {MAX_BYTES}")
        data = read_regular(path)
    except OSError as error:
        raise MeshError(f"{path}: {error.strerror}") from error
    if data.startswith(LFS_POINTER):
        raise MeshError(f"{path}: a Git LFS pointer; run `git lfs pull` in that repository")
    return data


def find_file(name: str, beside: Path, within: Path) -> Path:
    """The file `name`, relative to the folder `beside`, below the folder `within`. Raises
    MeshError."""
    check_name(name)
    path = (beside / name).resolve()
    if not path.is_relative_to(within.resolve()):
        raise MeshError(f"{name!r} is outside of {within}; copy the file there")
    if path.is_file():
        return path
    missing = "is no regular file" if path.exists() else f"was not found in {beside}"
    raise MeshError(f"{name!r} {missing}")


def find_or_note(name: str, what: str, beside: Path, within: Path, notes: list[str]) -> Path | None:
    """The file that a mesh file names as its `what`; None and a note if it is missing. Raises
    MeshError for one outside of `within`."""
    try:
        return find_file(name, beside, within)
    except MeshError as error:
        if "outside of" in str(error):
            raise
        notes.append(f"has no {what}: {error}; it is drawn without")
        return None


def check_name(name: str) -> None:
    """Raise MeshError for an empty or too long name, a URL or an absolute path."""
    if not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        raise MeshError(f"{name[:60]!r} is no name of a file")
    if "://" in name:
        raise MeshError(f"{name!r} is a URL; name a file relative to this one")
    if Path(name).is_absolute() or PureWindowsPath(name).drive or name.startswith("\\"):
        raise MeshError(f"{name!r} is an absolute path; name the file relative to this one")


def parse_xml(data: bytes) -> Any:
    """Parse XML. Raises MeshError, also for a document type."""
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        huge_tree=True,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, LookupError, ValueError) as error:
        why = " ".join(str(error).split())[:160]
        raise MeshError(f"not readable as XML ({why})") from error
    if root.getroottree().docinfo.doctype:
        raise MeshError("declares a document type, which it does not need; remove <!DOCTYPE ...>")
    return root


def pixels(data: bytes) -> Pixels:
    """Image (H,W,4) sRGB, at most TEXTURE long. Raises MeshError."""
    from PIL import Image  # takes longer than a robot without textures

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data)).convert("RGBA")
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise MeshError("has a texture of too many pixels; make it smaller") from error
    except (OSError, ValueError, SyntaxError) as error:
        why = " ".join(str(error).split())[:80]
        raise MeshError(f"has a texture that is no image ({why})") from error
    if (scale := TEXTURE / max(image.size)) < 1:
        width, height = (max(1, round(edge * scale)) for edge in image.size)
        image = image.resize((width, height))
    return np.array(image, np.uint8)


FOLDERS_ABOVE = 2  # folders above that of a file below which its meshes may lie
PACKAGE = "package.xml"
SCHEMES = ("package", "model")


@dataclass(frozen=True)
class Folders:
    urdf: Path
    root: Path
    packages: Mapping[str, Path]

    def find(self, name: str) -> tuple[Path, Path]:
        """The file that a URDF names, and the folder that bounds it. NAME of `package://NAME/FILE`
        is the user's directory for it, a folder above the URDF of that name or package.xml, or one
        beside those. Raises MeshError."""
        scheme, _, rest = name.rpartition("://")
        if scheme not in SCHEMES:
            return find_file(name, self.urdf.parent, self.root), self.root
        package, _, file = rest.partition("/")
        folder = self._package(package)
        if folder is None:
            what = f"{name[:120]!r} is of the package {package[:60]!r}"
            raise MeshError(f"{what}, which is not here: give --package {package}=DIR")
        return find_file(file, folder, folder), folder

    def _package(self, name: str) -> Path | None:
        if name in self.packages:
            return self.packages[name].resolve()
        if not name or name.startswith("."):
            return None
        above = [
            folder for folder in self.urdf.resolve().parents if folder.is_relative_to(self.root)
        ]
        own = [folder for folder in above if name in (folder.name, _package_name(folder))]
        return next(filter(Path.is_dir, (*own, *(folder / name for folder in above))), None)


def folders_of(
    urdf: Path, root: Path | None = None, packages: Mapping[str, Path] | None = None
) -> Folders:
    """The default root is the file's package, else FOLDERS_ABOVE."""
    if root is None or not root.is_dir():
        above = list(urdf.resolve().parents)[: 1 + FOLDERS_ABOVE]
        root = next((folder for folder in above if (folder / PACKAGE).is_file()), above[-1])
    return Folders(urdf, root.resolve(), packages or {})


def _package_name(folder: Path) -> str:
    try:
        return parse_xml(read_bytes(folder / PACKAGE)).findtext("name", "").strip()
    except MeshError:
        return ""
