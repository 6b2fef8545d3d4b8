"""What the versions of the LeRobot format share."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.data.process.machine import freeze_garbage
from pipeline.data.spec import EpisodeSpec
from pipeline.export.exporter import Exporter, Job
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import EPISODES, FAILURES, Facts, exported_cameras, same
from pipeline.export.shared.record import write_card, write_json
from pipeline.export.shared.statistics import Stats, image_stats, vector_stats
from pipeline.export.shared.tables import Provenance
from pipeline.poses import Ints

from .format import TEXT_FEATURES, data_columns, described_cameras, features_of, image_key, modality
from .options import INDEX, LerobotOptions, datasets_of, index_row
from .videos import Prepared, prepare_all


class LerobotExporter[O: LerobotOptions](Exporter[O]):
    """One or several datasets, each made by a `writer`, of episodes like the first."""

    version: str
    writer: "type[Writer]"

    def write(self, job: Job[O], draft: ExportDraft) -> dict[str, Any]:
        job.options.video()  # refused before anything is read
        parts, index, per_task = dict[str, Any](), list[dict[str, Any]](), job.options.per_task
        with freeze_garbage():
            for name, place in datasets_of(job.episodes, draft.folder, per_task).items():
                parts[name], specs = self._write_dataset(job, draft, *place)
                path = place[0].relative_to(draft.folder).as_posix()
                index.append(index_row(path, parts[name], specs))
        if len(parts) > 1 or per_task:
            write_json(draft.folder / INDEX, index)
        return {
            "version": self.version,
            "embodiments": sorted({row["embodiment"] for row in index}),
            **{key: sum(p[key] for p in parts.values()) for key in ("episodes", "frames")},
            "fps": {name: p["fps"] for name, p in parts.items()},
        }

    def _write_dataset(
        self, job: Job[O], draft: ExportDraft, root: Path, paths: Sequence[Path]
    ) -> tuple[dict[str, Any], list[EpisodeSpec]]:
        writer: Writer | None = None
        specs, options = list[EpisodeSpec](), job.options
        workers = min(job.workers, len(paths))
        try:
            for episode in prepare_all(paths, job.dataset, options, workers):
                writer = writer or self.writer(draft, root, episode.facts, options)
                writer.append(episode)
                specs.append(episode.facts.spec)
                job.advance()
        finally:
            if writer is not None:
                writer.close()
        assert writer is not None
        return writer.finish(), specs

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        """One a dataset; none for a single one."""
        roots = [path.parent.parent for path in sorted(folder.rglob("meta/info.json"))]
        names = [root.relative_to(folder).as_posix() for root in roots if root != folder]
        return [
            {"config_name": name.replace("/", "-"), "data_files": f"{name}/data/*/*.parquet"}
            for name in names
        ]


class Writer(ABC):
    def __init__(
        self, draft: ExportDraft, root: Path, first: Facts, options: LerobotOptions
    ) -> None:
        self.draft, self.root, self.first, self.codec = draft, root, first, options.video()
        self.names = exported_cameras(first, options.camera_names)
        self.features = features_of(first, self.codec, self.names)
        self.tasks: dict[str, int] = {}
        self.provenance = Provenance(root / "meta" / "domino_episodes.parquet", draft)
        self.colors: dict[str, Ints] = {}
        self.sampled = self.frames = 0

    def begin(self, episode: Prepared) -> tuple[int, dict[str, Any], dict[str, Stats]]:
        """Index, columns and statistics of the next episode. Raises ExportError if it does not
        fit."""
        facts, index = episode.facts, self.provenance.count
        same(self.first, facts)
        for text in facts.told:
            self.tasks.setdefault(text, len(self.tasks))
        columns = data_columns(facts, self.names, index, self.frames, self.tasks)
        stats = {k: vector_stats(v) for k, v in columns.items() if k not in TEXT_FEATURES}
        for camera, counts in episode.colors.items():
            key = image_key(self.names[camera])
            stats[key] = image_stats(counts, episode.sampled)
            self.colors[key] = self.colors.get(key, 0) + counts
        return index, columns, stats

    def end(self, episode: Prepared) -> None:
        self.provenance.append(episode.facts)
        self.sampled += episode.sampled
        self.frames += episode.facts.kept

    @abstractmethod
    def append(self, episode: Prepared) -> None: ...

    def close(self) -> None:
        self.provenance.close()

    @property
    def splits(self) -> dict[str, str]:
        name = FAILURES if self.first.meta.failure else "train"
        return {name: f"0:{self.provenance.count}"}

    def finish(self) -> dict[str, Any]:
        meta, first = self.root / "meta", self.first
        counts = {"episodes": self.provenance.count, "frames": self.frames}
        summary = counts | {"tasks": len(self.tasks), "fps": first.fps}
        write_json(meta / "modality.json", modality(first, self.names))
        described = {
            "embodiment": first.spec.embodiment,
            "physics_key": first.meta.physics_key,
            "encoder": {"name": self.codec.name, **self.codec.options()},
            "cameras": described_cameras(first, self.names),
            "names": list(first.log.vector_names),
        }
        write_json(meta / "domino.json", summary | described)
        split = FAILURES if first.meta.failure else EPISODES
        text = f"{first.spec.embodiment}, {self.frames} frames at {first.fps} Hz (docs/exports.md)."
        configs = [{"config_name": "default", "data_files": "data/*/*.parquet"}]
        card = summary | {"format": self.draft.format, "split": split}
        write_card(self.root, card, configs, text, ("LeRobot",))
        return summary
