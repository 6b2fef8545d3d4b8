"""Publishes an export on the Hugging Face hub. No token is printed."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.data.names import EXPORT_RECORD

from .shared.episodes import ExportError
from .shared.record import CARD, read_card, read_record

FILES = 100_000
FILES_OF_A_FOLDER = 10_000
TAGS = {"lerobot": "v3.0", "lerobot-v2.1": "v2.1"}


@dataclass(frozen=True)
class Shipment:
    """What an upload would send, and what the hub would refuse. `unlisted` files stay here."""

    folder: Path
    repo_id: str
    private: bool
    format: str
    tag: str | None
    files: dict[str, int]
    problems: tuple[str, ...]
    unlisted: tuple[str, ...] = ()

    @property
    def bytes(self) -> int:
        return sum(self.files.values())

    def as_dict(self) -> dict[str, Any]:
        values = {key: getattr(self, key) for key in ("repo_id", "private", "format", "tag")}
        counts = {"files": len(self.files), "bytes": self.bytes}
        return values | counts | {"problems": list(self.problems)}

    def describe(self) -> str:
        kinds = Counter[str]()
        for name, size in self.files.items():
            kinds[Path(name).suffix.partition("-")[0] or Path(name).name] += size
        parts = ", ".join(f"{kind} {size / 1e6:.1f} MB" for kind, size in kinds.most_common())
        who = "a private" if self.private else "a PUBLIC"
        tag = f", tag {self.tag}" if self.tag else ""
        lines = [
            f"{self.folder} -> {who} dataset repository {self.repo_id}{tag}",
            f"{len(self.files)} files, {self.bytes / 1e6:.1f} MB: {parts}",
            *(f"stays here, it is no part of the export: {name}" for name in self.unlisted),
            *(f"not taken by the hub: {problem}" for problem in self.problems),
        ]
        return "\n".join(lines)


def prepare(folder: Path, repo_id: str, private: bool) -> Shipment:
    """What publishing would send. Raises ExportError, also for a file that has changed."""
    from huggingface_hub.errors import HFValidationError
    from huggingface_hub.utils import validate_repo_id

    record = read_record(folder)
    try:
        validate_repo_id(repo_id)
    except HFValidationError as error:
        raise ExportError(f"--repo-id: {' '.join(str(error).split())}") from error
    for name in sorted(record.contents):
        if problem := record.problem(name):
            raise ExportError(f"{folder / name}: {problem}: export again before publishing")
    names = sorted({*record.contents, EXPORT_RECORD})
    files = {name: (folder / name).stat().st_size for name in names}
    stays = tuple(name for name in record.unlisted() if not name.startswith(".cache/"))
    kind = str(record.summary["format"])
    # several robots or --per-task: LeRobot datasets in directories, which no revision names
    tag = TAGS.get(kind) if "meta/info.json" in files else None
    problems = tuple(_problems(folder, files))
    return Shipment(folder, repo_id, private, kind, tag, files, problems, stays)


def _problems(folder: Path, files: dict[str, int]) -> list[str]:
    problems = []
    if len(files) > FILES:
        fix = "export with --per-task and publish the parts one by one"
        problems.append(f"{len(files)} files, {FILES} are allowed: {fix}")
    for name, n in Counter(Path(name).parent.as_posix() for name in files).items():
        if n > FILES_OF_A_FOLDER:
            problems.append(f"{name}/ has {n} files, {FILES_OF_A_FOLDER} are allowed")
    try:
        read_card(folder / CARD)
    except (OSError, ValueError) as error:
        problems.append(f"no card can be read: {error}")
    return problems


def publish(shipment: Shipment, api: Any) -> str:
    """The address on the hub. `api` is a HfApi with a token. Raises ExportError."""
    from httpx import HTTPError  # what huggingface_hub raises, too
    from huggingface_hub import CommitOperationAdd

    folder, repo, kind = shipment.folder, shipment.repo_id, {"repo_type": "dataset"}
    if shipment.problems:
        raise ExportError(f"{folder}: {shipment.problems[0]}")
    contents: dict[str, Any] = {name: str(folder / name) for name in shipment.files}
    files = [CommitOperationAdd(name, content) for name, content in contents.items()]
    try:
        url = api.create_repo(repo, private=shipment.private, exist_ok=True, **kind)
        api.create_commit(repo, files, commit_message="Publish with domino-data", **kind)
        if shipment.tag is not None:
            api.create_tag(repo, tag=shipment.tag, exist_ok=True, **kind)
    except (HTTPError, OSError) as error:
        token, message = getattr(api, "token", None), " ".join(str(error).split())[:300]
        message = message.replace(token, "***") if isinstance(token, str) else message
        raise ExportError(f"{repo}: the hub refused: {message}") from error
    return str(url)
