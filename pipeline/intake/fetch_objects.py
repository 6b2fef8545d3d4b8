"""`domino-data objects fetch`: objects from a wheel or the Hugging Face hub. Nothing of theirs
is run.
"""

import csv
import hashlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from zipfile import BadZipFile, ZipFile

from pipeline.data.atomic import atomic_directory, write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.keys import digest, file_hash
from pipeline.world.objects.from_files import TOML, ObjectError

from .catalogue.object_check import check_object
from .objects.add import add_objects, describe
from .objects.draft import ObjectOptions

USED = (".mtl", ".png", ".jpg", ".jpeg", ".txt")
LICENCES = ("LICENSE", "LICENCE", "AUTHORS", "COPYING", "METADATA", "README")
TOTAL = 16 << 30  # bytes that are unpacked at most
CLIENT_OPTIONS = (
    *("download", "--quiet", "--no-deps", "--only-binary=:all:"),
    # a wheel for one platform is read on all
    *("--python-version=3.11", "--platform=manylinux2014_x86_64"),
)


class FetchedObject(NamedTuple):
    """An object of a source: its mesh, and scale in m per unit."""

    name: str
    family: str
    file: str
    scale: float
    up: str | None
    words: tuple[str, ...]


class Wheel(NamedTuple):
    """A release on the package index; `content` is the used files' digest."""

    package: str
    version: str
    licence: str
    content: str
    textures: str = ""


class HubDataset(NamedTuple):
    """A dataset on the hub; `archive` is the zip file that holds RoboTwin's objects."""

    repository: str
    licence: str
    archive: str = ""


WHEELS = {
    "robosuite": Wheel(
        *("robosuite", "1.5.2", "MIT", "0d6eea85a818c5069f18a3dc0760dda0"),
        "robosuite/models/assets/textures",
    ),
    "pybullet": Wheel("pybullet", "3.2.7", "zlib", "6e0d06a2c6ab6a91f5facfb63a84426b"),
    "mani_skill": Wheel("mani_skill", "3.0.1", "CC-BY-NC-4.0", "d69025deea7c201e2ab4e4199be29143"),
}
HUB = {
    "ycb": HubDataset("ai-habitat/ycb", "CC-BY-4.0"),
    "robotwin": HubDataset("TianxingChen/RoboTwin2.0", "MIT", "objects.zip"),
}


def read_catalogue(source: str) -> list[FetchedObject]:
    with Path(__file__).with_name("fetched_objects.csv").open(newline="") as file:
        rows: list[dict[str, Any]] = [r for r in csv.DictReader(file) if r.pop("source") == source]
    for row in rows:
        row["scale"], row["up"] = float(row["scale"]), row["up"] or None
        row["words"] = tuple(row["words"].split("|"))
    return [FetchedObject(**row) for row in rows]


def fetch_wheel(source: str, to: Path, given: Path | None = None) -> Iterator[str]:
    """Make the objects of a wheel, by default downloaded; a line for each. Raises ObjectError."""
    wheel, wanted = WHEELS[source], read_catalogue(source)
    with tempfile.TemporaryDirectory() as temporary:
        files = Path(temporary, "files")
        archive = given or download_wheel(wheel, Path(temporary))
        unpack(archive, _is_used(wanted, wheel.textures), files)
        check_content(files, wheel, str(given or wheel.package))
        _keep_licences(files.rglob("*"), files, to / "licences" / source)
        yield from make_objects(wanted, files, to, f"{wheel.licence} ({source} {wheel.version})")


def fetch_dataset(source: str, to: Path, api: Any, revision: str) -> Iterator[str]:
    """Objects of a dataset on the hub, a line for each. Raises ObjectError."""
    dataset, wanted = HUB[source], read_catalogue(source)
    with tempfile.TemporaryDirectory() as temporary:
        files, licences = Path(temporary), to / "licences" / source
        names = [dataset.archive] if dataset.archive else [each.file for each in wanted]
        stated = download_dataset(dataset.repository, names, files, api, revision)
        _keep_licences(files.glob("*"), files, licences)
        write_atomic(licences / "source.json", json.dumps(stated, indent=2).encode())
        if not dataset.archive:
            licence = f"{dataset.licence} ({dataset.repository} {stated['revision'][:12]})"
            yield from make_objects(wanted, files, to, licence)
            return
        with atomic_directory(to / source) as unpacked:
            unpack(files / dataset.archive, lambda name: True, unpacked)
        yield f"wrote {to / source}; use it with: --assets robotwin:{to / source}"


def _is_licence(name: str) -> bool:
    return name.upper().startswith(LICENCES)


def _keep_licences(paths: Iterable[Path], files: Path, to: Path) -> None:
    for path in [path for path in paths if path.is_file() and _is_licence(path.name)]:
        write_atomic(to / path.relative_to(files), path.read_bytes())


def make_objects(
    wanted: Iterable[FetchedObject], files: Path, to: Path, licence: str
) -> Iterator[str]:
    """Add and check the objects below `files`; existing ones are kept, failing ones removed."""
    for each in wanted:
        if (to / "objects" / each.name / TOML).is_file():
            yield f"{each.name}: is there already"
            continue
        mesh = files / each.file
        if mesh.suffix == ".orig":  # beside it lies one whose texture is compressed
            mesh = mesh.rename(mesh.with_name("original.glb"))
        options = ObjectOptions(
            *(each.name, each.family, to, None, None, each.up, each.scale),
            *(each.words, licence, files),
        )
        try:
            (added,) = add_objects(mesh, options)
        except DominoError as error:
            yield f"{each.name}: left out: {error}"
            continue
        failed = [finding for finding in check_object(each.name) if not finding.ok]
        if failed:
            shutil.rmtree(added.directory)
            yield f"{each.name}: left out: {failed[0].name}: {failed[0].detail}"
        else:
            yield f"{each.family}: {next(describe(added._replace(notes=())))}"


def unpack(archive: Path, is_used: Callable[[str], bool], into: Path) -> None:
    """Write the used members of a zip file below `into`, links as plain files. Raises
    ObjectError."""
    try:
        with ZipFile(archive) as file:
            members = [member for member in file.infolist() if is_used(member.filename)]
            if sum(member.file_size for member in members) > TOTAL:
                raise ObjectError(f"{archive}: holds more than {TOTAL >> 30} GiB")
            file.extractall(into, members)
    except (BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise ObjectError(f"{archive}: cannot be read as a zip file: {error}") from error


def _is_used(wanted: Iterable[FetchedObject], textures: str) -> Callable[[str], bool]:
    meshes = {each.file for each in wanted}
    folders = {str(PurePosixPath(file).parent) for file in meshes} | {textures}

    def is_used(name: str) -> bool:
        path = PurePosixPath(name)
        if len(path.parts) > 1 and path.parts[0].endswith(".dist-info"):
            return _is_licence(path.name)
        return name in meshes or (str(path.parent) in folders and path.suffix.lower() in USED)

    return is_used


def check_content(files: Path, wheel: Wheel, what: str) -> None:
    names = [path.relative_to(files) for path in sorted(files.rglob("*")) if path.is_file()]
    own = [name for name in names if ".dist-info" not in str(name)]
    if digest([[name.as_posix(), file_hash(files / name)] for name in own]) != wheel.content:
        raise ObjectError(f"{what}: is not {wheel.package} {wheel.version}: give it with --wheel")


def download_wheel(wheel: Wheel, into: Path) -> Path:
    """The wheel, downloaded by pip, of uv if there is one. Raises ObjectError."""
    requirement = f"{wheel.package}=={wheel.version}"
    client = ["uvx", "--quiet", "pip"] if shutil.which("uvx") else ["pip"]
    command = [*client, *CLIENT_OPTIONS, "--dest", str(into), requirement]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["nothing was downloaded"])[-1]
        raise ObjectError(f"{requirement}: pip: {reason}; give the file with --wheel")
    return next(into.glob("*.whl"))


def download_dataset(
    repository: str, names: Iterable[str], into: Path, api: Any, revision: str
) -> dict[str, Any]:
    """Download files and licences of a commit, checked by the hub's hashes, which are returned."""
    from httpx import HTTPError  # what huggingface_hub raises, too

    hashes = dict[str, str]()
    try:
        info = api.dataset_info(repository, revision=revision, files_metadata=True)
        listed = {file.rfilename: file for file in info.siblings or ()}
        if missing := [name for name in names if name not in listed]:
            raise ObjectError(f"{repository} {revision}: holds no {missing[0]}")
        options = {"repo_type": "dataset", "revision": info.sha, "local_dir": into}
        for name in (*names, *(n for n in listed if "/" not in n and _is_licence(n))):
            path = Path(api.hf_hub_download(repository, name, **options))
            hashes[name] = _check_file(path, listed[name], f"{repository} {name}")
    except (HTTPError, OSError) as error:
        raise ObjectError(f"{repository}: {' '.join(str(error).split())[:300]}") from error
    return {"repository": repository, "revision": info.sha, "sha256": hashes}


def _check_file(path: Path, stated: Any, what: str) -> str:
    """A file's SHA-256; small files are checked by git's SHA-1."""
    found, blob = file_hash(path), f"blob {path.stat().st_size}\0".encode() + path.read_bytes()
    own = hashlib.sha1(blob, usedforsecurity=False).hexdigest() if stated.lfs is None else found
    if own != (stated.blob_id if stated.lfs is None else stated.lfs.sha256):
        raise ObjectError(f"{what}: is not what the hub states; fetch it again")
    return found
