"""Whether an annotation was made from what its episode shows now: hashes of its inputs, computed again from the episode file."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.data.annotations import CorruptAnnotation, Entry, annotation_path, read_entry
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import arrays_digest, frames_digest
from pipeline.export.shared.episodes import Facts

TRUTH = {"flow": ("actor_segmentation", "depth"), "masks": ("actor_segmentation",)}
"""Arrays of a camera that a stage reads where it is computed from the simulator's truth."""


def stale(entry: Entry, stage: Mapping[str, Any], file: EpisodeFile, facts: Facts, dataset: Path) -> str | None:
    """What an annotation was not made from, in words, or None if all its inputs are those of the open episode.

    `stage` is the content of stage.json. Which sentences were asked for is not compared.
    """
    inputs = entry.attributes.get("inputs")
    if not isinstance(inputs, Mapping):
        return "it does not name what it was made from"
    now = dict(_inputs(inputs, stage, file, facts, dataset))
    changed = [name for name, value in now.items() if inputs[name] != value]
    known = {"frames": "images", "scene": "physics", "assets": "assets", "stored": "truth", "masks": "masks"}
    return f"it was made from other {known[changed[0]]}" if changed else None


def _inputs(
    inputs: Mapping[str, Any], stage: Mapping[str, Any], file: EpisodeFile, facts: Facts, dataset: Path
) -> Iterator[tuple[str, Any]]:
    camera = str(stage["parameters"]["camera"])
    if camera not in facts.cameras:
        yield next(name for name in ("frames", "scene") if name in inputs), None
        return
    if "frames" in inputs:
        yield "frames", frames_digest(file.array(f"observation/{camera}/rgb").tolist())
    if "scene" in inputs:
        k = file.array(f"observation/{camera}/intrinsic_cv")[0]
        state = {"poses": facts.log.poses, "camera": facts.camera_poses[camera], "k": k}
        yield "scene", {"bodies": list(facts.log.bodies), "state": arrays_digest(state)}
    if "assets" in inputs:
        yield "assets", dict(facts.meta.drawing.assets)
    if "stored" in inputs:
        yield "stored", _read_hash(file, camera, TRUTH[stage["stage"]])
    if "masks" in inputs:
        yield "masks", _masks(dataset, str(stage["parameters"]["masks"]), facts)


def _read_hash(file: EpisodeFile, camera: str, names: tuple[str, ...]) -> str | None:
    try:
        return arrays_digest({name: file.array(f"observation/{camera}/{name}") for name in names})
    except EpisodeError:
        return None


def _masks(dataset: Path, directory: str, facts: Facts) -> str | None:
    try:
        return read_entry(annotation_path(dataset, directory, Path(facts.source).relative_to("episodes"))).checksum
    except (FileNotFoundError, CorruptAnnotation, ValueError):
        return None


def command(dataset: Path, stage: Mapping[str, Any]) -> str:
    """The command that annotates again as a stage.json says."""
    name, said = stage["stage"], stage["parameters"]
    options = {"--stages": "masks,features" if name == "features" else name, "--cameras": said["camera"]}
    if name == "flow":
        size = said.get("size")
        options |= {"--flow-source": said.get("source"), "--flow-stride": said.get("stride")}
        options |= {"--flow-size": f"{size[1]}x{size[0]}" if size else None}
    else:
        options |= {"--mask-source": said.get("mask_source" if name == "features" else "source"), "--prompt": said.get("prompt")}
    return f"domino-data annotate {dataset} " + " ".join(f"{o} {value}" for o, value in options.items() if value is not None)
