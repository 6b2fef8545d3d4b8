"""export.json, compared with directory and dataset; and the card."""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from pipeline.data.keys import SEAL, file_hash, is_unchanged, seal
from pipeline.data.names import EXPORT_RECORD
from pipeline.data.parsing import parse_json
from pipeline.data.reading import IRREGULAR, read_regular

from .episodes import FAILURES, ExportError, source_of

PARTS = ("code", "inputs", "contents")

AGAIN = "remove the directory and export again"

CACHE_FOLDERS = {".cache", "__pycache__", ".ipynb_checkpoints"}
CACHE_SUFFIXES = {".pkl", ".pyc", ".lock"}
CACHE_NAMES = re.compile(r"(.*/)?meta/[^/]*stats[^/]*\.json|(.*/)?(\.DS_Store|Thumbs\.db)")
"""Caches that training code writes into a dataset (StarVLA meta/stats_gr00t.json, the hub's client
.cache/): nothing keeps, checks or publishes them."""


@dataclass(frozen=True)
class ExportRecord:
    root: Path
    summary: Mapping[str, Any]
    code: Mapping[str, str]
    inputs: Mapping[str, str | None]
    contents: Mapping[str, Mapping[str, Any]]

    def write(self) -> None:
        values = {**self.summary, **{part: getattr(self, part) for part in PARTS}}
        (self.root / EXPORT_RECORD).write_bytes(seal(values) + b"\n")

    def problem(self, name: str) -> str | None:
        """A file's fault, such as "is missing". Cards may be edited."""
        path = self.root / name
        try:
            if path.is_symlink() or path.resolve() != self.root.resolve() / name:
                return "is a link, not what was written"
            if not path.exists():
                return "is missing"
            if name.endswith(".md") and path.is_file():
                return None
            same = file_hash(path) == self.contents[name]["sha256"]
            return None if same else "is not what was written"
        except OSError as error:
            why = error.strerror
            return IRREGULAR if why == IRREGULAR else f"cannot be read ({why})"

    def unlisted(self) -> list[str]:
        """What is there and was not written, sorted."""
        return sorted({*entries(self.root)} - {*self.contents, EXPORT_RECORD})

    def foreign(self) -> list[Path]:
        return [self.root / name for name in self.unlisted() if not _is_cache(name)]

    def check(self, dataset: Path, episodes: Sequence[Path]) -> list[str]:
        """The problems of directory and episodes, by hashes. Raises ExportError."""
        judged = [(name, self.problem(name)) for name in sorted(self.contents)]
        problems = [f"{self.root / name}: {problem}" for name, problem in judged if problem]
        now = {source_of(path, dataset): path for path in episodes}
        for name, sha in self.inputs.items():
            annotation = dataset / name if name.startswith("annotations/") else None
            path = now.get(name, annotation)
            if path is None:
                problems.append(f"{self.root}: holds {name}, which is not among the episodes")
                continue
            try:
                if path.exists() and file_hash(path) != sha:
                    problems.append(f"{self.root}: {path} has changed since")
            except OSError as error:
                raise ExportError(f"{path}: cannot be read ({error.strerror})") from error
        missing = (path for name, path in now.items() if name not in self.inputs)
        return problems + [f"{self.root}: does not hold {path}" for path in missing]


def read_record(out: Path) -> ExportRecord:
    """Read export.json. Raises ExportError."""
    try:
        if (out / EXPORT_RECORD).is_symlink():
            raise ValueError("it is a link")
        summary = dict(parse_json(read_regular(out / EXPORT_RECORD)))
    except (OSError, ValueError, TypeError) as error:
        raise ExportError(f"{out}: has no readable {EXPORT_RECORD} ({error}); {AGAIN}") from error
    sealed, _ = is_unchanged(summary), summary.pop(SEAL, None)
    code, inputs, contents = parts = [summary.pop(part, None) for part in PARTS]
    whole = all(isinstance(part, dict) for part in parts)
    whole = whole and all(map(_is_plain, {**inputs, **contents}))
    if not whole or not all(map(_is_entry, contents.values())):
        raise ExportError(f"{out}: its {EXPORT_RECORD} is of another version; {AGAIN}")
    if not sealed:
        raise ExportError(f"{out}: its {EXPORT_RECORD} is not what was written; {AGAIN}")
    return ExportRecord(out, summary, code, inputs, contents)


def _is_plain(name: str) -> bool:
    return bool(name) and not name.startswith("/") and ".." not in name.split("/")


def _is_entry(entry: Any) -> bool:
    kinds = {"sha256": str, "bytes": int}
    return isinstance(entry, dict) and all(isinstance(entry.get(k), t) for k, t in kinds.items())


def entries(folder: Path) -> Iterator[str]:
    """Links are not followed."""
    for place, folders, files in os.walk(folder):
        links = (each for each in folders if os.path.islink(os.path.join(place, each)))
        for name in (*files, *links):
            yield Path(place, name).relative_to(folder).as_posix()


def _is_cache(name: str) -> bool:
    path = PurePosixPath(name)
    inside = CACHE_FOLDERS & {*path.parts} or path.suffix in CACHE_SUFFIXES
    return bool(inside or CACHE_NAMES.fullmatch(name))


def json_text(value: Any) -> str:
    return json.dumps(value, indent=2, sort_keys=True) + "\n"


def write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json_text(value))


CARD = "README.md"
LICENSE = "apache-2.0"
TAGS = ("domino", "robotics", "simulation", "dynamic-manipulation")
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M"}


def size_category(rows: int) -> str:
    return next((name for limit, name in SIZES.items() if rows < limit), "10M<n<100M")


def write_card(
    folder: Path,
    summary: Mapping[str, Any],
    configs: Sequence[Mapping[str, Any]],
    text: str,
    tags: Sequence[str] = (),
) -> None:
    """Front matter that the format wrote stays; its text if there is no `text`."""
    path = folder / CARD
    front, before = read_card(path) if path.exists() else ({}, "")
    what = "failed attempts in simulation" if summary["split"] == FAILURES else "simulated episodes"
    name = f"Dynamic manipulation, {summary['episodes']} {what} ({summary['format']})"
    ours: dict[str, Any] = {
        "license": LICENSE,
        "pretty_name": name,
        "task_categories": ["robotics"],
        "tags": [*tags, *TAGS, summary["format"]],
    }
    if "frames" in summary:
        ours["size_categories"] = [size_category(summary["frames"])]
    if configs:
        ours["configs"] = [dict(config) for config in configs]
    front |= {key: value for key, value in ours.items() if key not in front}
    text = (text or before).strip("\n") or f"# {front['pretty_name']}"
    header = yaml.safe_dump(front, sort_keys=False, allow_unicode=True)
    path.write_text(f"---\n{header}---\n\n{text}\n")


def read_card(path: Path) -> tuple[dict[str, Any], str]:
    begin, sign, rest = path.read_text().partition("---\n")
    front, end, text = rest.partition("\n---\n")
    if begin.strip() or not sign or not end:
        raise ValueError(f"{path}: has no front matter")
    return dict(yaml.safe_load(front)), text.strip("\n") + "\n"
