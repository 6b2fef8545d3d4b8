"""Annotation on workers: the same bytes as inline, and an episode that kills its worker costs that
episode only."""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pipeline.annotate.flow_stage import FlowStage
from pipeline.annotate.options import AnnotateOptions, FlowOptions
from pipeline.annotate.stage import StageResult
from pipeline.annotate.store import episode_paths
from pipeline.crew.contract import Crew
from pipeline.run import annotate as module
from pipeline.run.annotate import annotate, leases, outcomes
from tests.synthetic import episode_path, make_episode

OPTIONS = AnnotateOptions(flow=FlowOptions(stride=2))
TWO = Crew("ray", 2)
FATAL = 3
pytestmark = pytest.mark.usefixtures("ray_session")


@dataclass(frozen=True)
class Fatal(FlowStage):
    """A stage whose process is killed, or stops, at episodes of four frames, as in a faulty native
    library."""

    name = "fatal"
    signal: int = signal.SIGKILL

    def compute(self, data: Any) -> StageResult:
        if len(data) == 4:
            os.kill(os.getpid(), self.signal)
        return super().compute(data)

    def start(self) -> Callable[[Any], StageResult]:
        return self.compute


def dataset(root: Path) -> Path:
    for slot in range(6):
        frames = 4 if slot == FATAL else 5
        make_episode(
            episode_path(root, slot=slot),
            slot=slot,
            seed=slot,
            frames=frames,
            cameras=("head_camera",),
        )
    return root


def tree(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted((root / "annotations").rglob("*"))
        if p.is_file()
    }


def test_two_workers_give_the_bytes_of_inline(tmp_path: Path):
    inline, pooled = dataset(tmp_path / "a"), dataset(tmp_path / "b")
    annotate(inline, ["flow"], options=OPTIONS)
    report = annotate(pooled, ["flow"], options=OPTIONS, crew=TWO, device="cpu")
    assert (report["stages"][0]["computed"], report["stages"][0]["failed"]) == (6, 0)
    assert tree(inline) == tree(pooled)
    again = annotate(pooled, ["flow"], options=OPTIONS, crew=TWO, device="cpu")
    assert (again["stages"][0]["computed"], again["stages"][0]["reused"]) == (0, 6)


@pytest.mark.parametrize(
    ("number", "word"),
    [
        (signal.SIGKILL, "died"),
        # the loop's own tests have one that hangs
        pytest.param(signal.SIGSTOP, "hung", marks=pytest.mark.slow),
    ],
)
def test_an_episode_that_takes_two_workers_is_reported_and_the_rest_done(
    tmp_path: Path, monkeypatch, number: int, word: str
):
    monkeypatch.setattr(module, "EPISODE_SECONDS", 3.0)
    # all six in one lease
    monkeypatch.setattr(module, "leases", lambda episodes, _: iter([tuple(episodes)]))
    root = dataset(tmp_path)
    found = {
        o.episode: o
        for o in outcomes(
            Fatal(FlowOptions(), signal=number), root, episode_paths(root), TWO, "cpu", False
        )
    }
    assert len(found) == 6
    failed = [o for o in found.values() if o.action == "failed"]
    assert [Path(o.episode).stem for o in failed] == [f"episode_{FATAL:07d}"]
    assert f"{word} twice" in failed[0].reason
    # the first three were written before their worker was lost
    assert [o.action for _, o in sorted(found.items())] == ["reused"] * 3 + ["failed"] + [
        "computed"
    ] * 2


def test_leases_are_small_many_and_complete():
    episodes = [str(i) for i in range(103)]
    for workers in (1, 2, 8, 200):
        found = list(leases(episodes, workers))
        assert [e for lease in found for e in lease] == episodes
        assert max(map(len, found)) <= 8
        assert len(found) >= min(103, 4 * workers)
