"""What is stored beside the episodes: the assets they were drawn from, their annotations, and the exports."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from pipeline.annotate.stage_key import annotation_key, stage_key
from pipeline.data.annotations import CorruptAnnotation, Entry, read_entry
from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.keys import frames_digest
from pipeline.data.parsing import parse_json
from pipeline.data.reading import check_regular, read_regular
from pipeline.data.store.mirror import fetch_below
from pipeline.export.shared.episodes import FAILURES, ExportError, select_episodes
from pipeline.export.shared.record import read_record
from pipeline.run.verify.tally import FAULTS, Finding, line, observe

RECOMPUTE = "run annotate again"


def check_assets(dataset: Dataset, named: Iterable[tuple[str, Mapping[str, str]]]) -> tuple[list[Finding], list[Path]]:
    """Check that the store holds, undamaged, the assets that each episode (name, assets by body) names; each is read once.

    Returns the findings, and all files that are missing or damaged."""
    store, known, findings = AssetStore(dataset.bodies), dict[str, str](), list[Finding]()
    holds = cache(partial(_holds, store))
    for name, assets in named:
        findings.append(observe("assets", assets, f"{name}: names no assets, so it cannot be drawn again"))
        for body, key in assets.items():
            if key not in known:
                known[key] = ""
                try:
                    store.get(key)
                except AssetError as error:
                    known[key] = f"{line(error)} ({body} of {name})"
                    findings.append(Finding("assets", known[key].replace(f"{dataset.root}/", "")))
    wanted = {store.path(key) for key in known}
    for path in sorted(p for p in dataset.bodies.rglob("*") if p.is_file() and p.suffix != ".tmp"):
        if path not in wanted and (path.suffix != ".npz" or not holds(path)):
            findings.append(Finding("strays", f"{path.relative_to(dataset.root)}: is no asset; remove it"))
    unnamed = [path for path in store.root.glob("*/*.npz") if path.stem not in known and not holds(path)]
    return findings, [*(store.path(key) for key, problem in known.items() if problem), *unnamed]


def _holds(store: AssetStore, path: Path) -> bool:
    """Whether a file of the store is an asset."""
    try:
        store.get(path.stem)
    except AssetError:
        return False
    return store.path(path.stem) == path


def check_stage(dataset: Dataset, directory: Path, wanted: Collection[Path]) -> Iterator[Finding]:
    """One directory of annotations: stage.json, and every file by itself; `wanted` are the episode files of the recipe."""
    check, where = f"annotations {directory.name}", directory.relative_to(dataset.root)
    try:
        stage = parse_json(read_regular(directory / "stage.json"))
        of = (str(stage["stage"]), int(stage["version"]), dict(stage["parameters"]))
        named = directory.name == f"{of[0]}@{stage_key(*of)}"
    except FAULTS as error:
        yield Finding(check, f"{where}/stage.json: cannot be read ({line(error)}); {RECOMPUTE}")
        return
    yield observe(check, named, f"{where}/stage.json: is not that of this directory; {RECOMPUTE}")
    if not named:
        return  # by another description every file would seem wrong
    for path in sorted(p for p in directory.rglob("*") if not p.is_dir() and p.suffix != ".tmp" and p.name != "stage.json"):
        name = path.relative_to(dataset.root).as_posix()
        episode = dataset.episodes / path.relative_to(directory).with_suffix(".hdf5")
        if path.suffix != ".h5" or (episode not in wanted and not episode.exists()):
            yield Finding("strays", f"{name}: belongs to no episode; remove it")
            continue
        try:
            check_regular(path)
            entry = read_entry(path)
        except (CorruptAnnotation, *FAULTS) as error:
            yield Finding(check, f"{name}: {line(error).removeprefix(f'{path}: ')}")
            continue
        inputs = entry.attributes.get("inputs", {})
        same = annotation_key(*of, inputs) == entry.key
        yield observe(check, same, f"{name}: its key is not that of its stage and inputs; {RECOMPUTE}")
        yield from _fits(check, name, entry, episode, of[2])


def _fits(check: str, name: str, entry: Entry, episode: Path, parameters: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether an annotation is of the frames that the episode has; an episode that cannot be read is another check's matter."""
    frames = entry.attributes.get("inputs", {}).get("frames")
    try:
        with EpisodeFile(episode) as file:
            now = frames_digest(bytes(data) for data in file.array(f"observation/{parameters['camera']}/rgb"))
    except FAULTS:
        return
    if frames is not None:
        yield observe(check, frames == now, f"{name}: was made from other frames than its episode has now; {RECOMPUTE}")


EXPORT_AGAIN = "export again"


def exports_of(dataset: Dataset) -> list[Path]:
    """Directories below exports/, sorted; what a process is just writing left out."""
    root = dataset.root / "exports"
    return sorted(p for p in root.iterdir() if not p.name.startswith(".")) if root.is_dir() else []


def check_export(dataset: Dataset, place: Path, episodes: Sequence[Path]) -> Iterator[Finding]:
    """One export against the episodes, all of which must be sound, by hashes. Its directory may have any name."""
    check, where = f"export {place.name}", place.relative_to(dataset.root)
    fetch_below(place)
    try:
        record = read_record(place)
    except FAULTS as error:
        yield Finding(check, f"{where}: cannot be read ({line(error).removeprefix(f'{place}: ')})")
        return
    for path in record.foreign():
        yield Finding("strays", f"{path.relative_to(dataset.root)}: is no part of the export; move it away")
    try:
        if record.summary.get("split") == FAILURES:
            episodes = dataset.intact_failures(dataset.recipe())
        problems = record.check(dataset.root, select_episodes(sorted(episodes), str(record.summary.get("where", ""))))
    except (ExportError, DatasetError, *FAULTS) as error:
        problems = [line(error)]
    yield from (Finding(check, f"{problem.replace(f'{dataset.root}/', '')}; {EXPORT_AGAIN}") for problem in problems)
    if not problems:
        yield Finding(check)
