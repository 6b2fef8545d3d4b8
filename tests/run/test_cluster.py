"""A cluster of two nodes on this machine: the same bytes, shares of a GPU, and nodes that are not
alike, or leave."""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from pipeline.crew.contract import Crew, CrewError, Done
from pipeline.crew.loop import run
from tests.run.command import WANTED, contents, start
from tests.run.processes import parents, title, wait_for

pytestmark = pytest.mark.slow
LONG = 60.0
NAME = "DOMINO_TEST_NODE"


@pytest.fixture(scope="module")
def cluster(tests_path: None) -> Iterator[Any]:
    """A head with a GPU that nobody looks at, and a second node."""
    from ray.cluster_utils import Cluster

    made = Cluster()
    try:
        made.add_node(num_cpus=4, num_gpus=1, env_vars={NAME: "first"}, include_dashboard=False)
        made.add_node(num_cpus=2, env_vars={NAME: "second"})
        yield made
    finally:
        made.shutdown()


def sleeper() -> Callable[[int], None]:
    return lambda _: time.sleep(0.5)


def test_two_nodes_build_the_bytes_of_one_process(cluster, built, tmp_path):
    out, seen = tmp_path / "out", set()
    process = start(
        "build", *WANTED, "--out", out, "--quiet", "--address", cluster.address, "--workers", 2
    )
    nodes = {node.all_processes["raylet"][0].process.pid for node in cluster.list_all_nodes()}
    while process.poll() is None:
        seen |= {
            tree[0]
            for pid, tree in parents().items()
            if tree[0] in nodes and title(pid).startswith("ray::CrewWorker.")
        }
        time.sleep(0.05)
    printed, err = process.communicate()
    assert process.returncode == 0, printed + err
    assert seen == nodes
    assert contents(out) == contents(built)


def test_four_workers_share_a_gpu_and_a_fifth_has_no_room(cluster, tmp_path):
    def make() -> Callable[[int], str]:
        def work(job: int) -> str:
            (tmp_path / str(job)).touch()
            wait_for(lambda: len(list(tmp_path.iterdir())) == 4, 60)
            return os.environ["CUDA_VISIBLE_DEVICES"]

        return work

    ends = list(run(make, deque(range(4)), Crew("ray", 4, cluster.address, gpus=0.25), LONG))
    assert [end.result for end in ends if isinstance(end, Done)] == ["0"] * 4
    with pytest.raises(CrewError, match="Ray has 1 GPUs, room for 4 workers"):
        list(run(make, deque(range(5)), Crew("ray", 5, cluster.address, gpus=0.25), LONG))


def test_a_node_that_is_not_like_the_others_is_named(cluster):
    def look() -> Mapping[str, str]:
        return {"renderer": os.environ[NAME]}

    def refuse() -> Mapping[str, str]:
        raise CrewError("the dataset is not there")

    unlike = r"its renderer is (first|second), that of node .+ is (first|second): have the same"
    for check, said in ((look, unlike), (refuse, "the dataset is not there")):
        # so many that both nodes start before they are done
        with pytest.raises(CrewError, match=f"^node .+: {said}") as caught:
            list(run(sleeper, deque(range(200)), Crew("ray", 2, cluster.address), LONG, check))
        assert "\n" not in str(caught.value)


def test_a_runtime_environment_reaches_the_workers(cluster):
    crew = Crew("ray", 1, cluster.address, runtime_env={"env_vars": {"WANTED": "yes"}})

    def make() -> Callable[[int], tuple[str, str]]:
        return lambda _: (os.environ["WANTED"], os.environ["OMP_NUM_THREADS"])

    assert [end.result for end in run(make, deque([0]), crew, LONG) if isinstance(end, Done)] == [
        ("yes", "1")
    ]


def test_a_node_that_leaves_is_not_the_fault_of_its_jobs(cluster, tmp_path: Path):
    def make() -> Callable[[int], str]:
        def work(_: int) -> str:
            (tmp_path / os.environ[NAME]).touch()
            wait_for((tmp_path / "gone").exists, 90)
            return os.environ[NAME]

        return work

    def leave() -> None:
        wait_for(lambda: {file.name for file in tmp_path.iterdir()} >= {"first", "second"}, 90)
        cluster.remove_node(next(node for node in cluster.list_all_nodes() if not node.head))
        (tmp_path / "gone").touch()

    lost = []
    leaving = threading.Thread(target=leave)
    leaving.start()
    crew = Crew("ray", 2, cluster.address)
    ends = list(run(make, deque([0, 1]), crew, 120.0, lost=lambda: lost.append(1)))
    leaving.join()
    assert lost == [1]
    assert [end.result for end in ends if isinstance(end, Done)] == ["first", "first"]
