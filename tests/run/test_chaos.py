"""A build that is killed at any moment ends as if nothing had been. With Ray workers, driver and
Ray killed a hundred times: python -m benchmarks.chaos."""

import multiprocessing
import time
from random import Random

from benchmarks.chaos.command import build_here
from benchmarks.chaos.compare import compare
from pipeline.run.names import recipe_from
from tests.run.command import temporaries

RECIPE = recipe_from(
    {
        "tasks": ["click_bell", "stamp_seal"],
        "embodiments": "aloha",
        "levels": [1],
        "episodes": 5,
        "attempts": 8,
    }
)


def test_a_build_that_is_killed_at_any_moment_ends_as_if_nothing_had_been(built, tmp_path):
    context, chance = multiprocessing.get_context("forkserver"), Random(1)
    context.set_forkserver_preload(["benchmarks.chaos.command"])
    root = tmp_path / "killed"

    def start(root):
        process = context.Process(target=build_here, args=(root, RECIPE, built))
        process.start()
        return process

    def made():
        return len(list(root.glob("episodes/**/*.hdf5")))

    reference = start(tmp_path / "reference")
    reference.join()
    assert reference.exitcode == 0
    killed = 0
    for wanted in (1, 3, 5, 7):
        process = start(root)
        while made() < wanted and process.is_alive():
            time.sleep(0.005)
        time.sleep(chance.random() / 20)
        process.kill()
        process.join()
        killed += process.exitcode == -9
        # deleting the index costs only reading
        for path in root.glob("index.*") if wanted == 5 else ():
            path.unlink()
    assert killed == 4
    last = start(root)
    last.join()
    assert last.exitcode == 0
    found = compare(tmp_path / "reference", root)
    assert found.identical, found
    assert found.slots == 10 and found.same > 10
    assert not temporaries(root)
