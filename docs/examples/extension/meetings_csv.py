"""A format: one CSV file with a row an episode, when its target was met and how fast it was."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.data.episode.file import open_episode
from pipeline.export import Exporter, Job, NoOptions, register
from pipeline.export.shared.draft import ExportDraft

HEAD = ["episode", "task", "level", "meeting (s)", "success (s)", "average speed (m/s)"]


def rows(episodes: Sequence[Path]) -> list[list[str]]:
    """The table, in the order of the episodes."""
    found = []
    for path in episodes:
        with open_episode(path) as file:
            episode = file.read()
        times = [f"{episode.log.time_of(event):.4f}" for event in ("meeting", "success")]
        found.append(
            [
                path.stem,
                episode.spec.task,
                str(episode.spec.level),
                *times,
                f"{episode.meta.average_speed:.4f}",
            ]
        )
    return found


@register
class MeetingsCsv(Exporter[NoOptions]):
    """One row an episode."""

    name = "meetings-csv"
    options = NoOptions

    def write(self, job: Job[NoOptions], draft: ExportDraft) -> dict[str, Any]:
        table = rows(job.episodes)
        with (draft.folder / "meetings.csv").open("w", newline="") as file:
            csv.writer(file).writerows([HEAD, *table])
        for _ in table:
            job.advance()
        return {"episodes": len(table)}
