"""Ray does the same work with the same bytes, and outlives a worker."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import ray

from pipeline.annotate.flow_stage import FlowStage
from pipeline.annotate.options import AnnotateOptions, FlowOptions
from pipeline.annotate.ray_pool import _leases, run_ray
from pipeline.annotate.runner import annotate
from pipeline.annotate.stage import Result
from pipeline.annotate.store import episode_paths
from tests.synthetic import episode_path, make_episode

OPTIONS = AnnotateOptions(flow=FlowOptions(stride=2))


@dataclass(frozen=True)
class Crashing(FlowStage):
    """A stage whose process dies at episodes of four frames, as a faulty native library would."""

    name = "crashing"

    def compute(self, data: Any) -> Result:
        if len(data) == 4:
            os._exit(1)
        return super().compute(data)

    def start(self) -> Callable[[Any], Result]:
        return self.compute


@pytest.fixture(scope="module")
def cluster() -> Iterator[None]:
    os.environ.setdefault("RAY_AUTH_MODE", "disabled")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, object_store_memory=80_000_000)
    yield
    ray.shutdown()


def dataset(root: Path) -> Path:
    for slot in range(6):
        frames = 4 if slot == 3 else 5
        make_episode(episode_path(root, slot=slot), slot=slot, seed=slot, frames=frames, cameras=("head_camera",))
    return root


def tree(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in sorted((root / "annotations").rglob("*")) if p.is_file()}


@pytest.mark.usefixtures("cluster")
def test_two_workers_give_the_bytes_of_inline(tmp_path: Path):
    inline, pooled = dataset(tmp_path / "a"), dataset(tmp_path / "b")
    annotate(inline, ["flow"], options=OPTIONS)
    report = annotate(pooled, ["flow"], options=OPTIONS, executor="ray", workers=2)
    assert (report["stages"][0]["computed"], report["stages"][0]["failed"]) == (6, 0)
    assert tree(inline) == tree(pooled)
    again = annotate(pooled, ["flow"], options=OPTIONS, executor="auto", workers=2)
    assert (again["stages"][0]["computed"], again["stages"][0]["reused"]) == (0, 6)


@pytest.mark.usefixtures("cluster")
def test_an_episode_that_kills_its_worker_twice_is_reported_and_the_rest_done(tmp_path: Path):
    root = dataset(tmp_path)
    outcomes = {o.episode: o for o in run_ray(Crashing(FlowOptions()), root, episode_paths(root), False, 1, "cpu")}
    assert len(outcomes) == 6
    failed = [o for o in outcomes.values() if o.action == "failed"]
    assert [Path(o.episode).stem for o in failed] == ["episode_0000003"]
    assert "died twice" in failed[0].reason
    assert sum(o.action in ("computed", "reused") for o in outcomes.values()) == 5


def test_leases_are_small_many_and_complete():
    episodes = [str(i) for i in range(103)]
    for workers in (1, 2, 8, 200):
        leases = list(_leases(episodes, workers))
        assert [e for lease in leases for e in lease] == episodes
        assert max(map(len, leases)) <= 8
        assert len(leases) >= min(103, 4 * workers)
