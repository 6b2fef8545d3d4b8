"""The engine on fake work: every job ends once, whatever becomes of its worker."""

import gc
import os
import signal
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from pipeline.crew.dispatch import run
from pipeline.crew.pool import Died, Done, EngineError, Limit, Pool, Strikes, pick_executor
from pipeline.crew.ray_session import session
from tests.run.processes import title

LONG = Limit[object](lambda _: 60.0)
TWO = Pool("ray", 2)


def doubled() -> Callable[[int], int]:
    return lambda job: 2 * job


def frozen_objects() -> Callable[[int], int]:
    return lambda _: gc.get_freeze_count()


def named_process() -> Callable[[int], tuple[int, int]]:
    """The work says which process did it and how many times this one was made."""
    made = []

    def work(_: int) -> tuple[int, int]:
        made.append(1)
        return os.getpid(), len(made)

    return work


def fatal_once(folder: Path, number: int) -> Callable[[], Callable[[int], int]]:
    """Work that sends its process a signal the first time it is given job 3."""

    def make() -> Callable[[int], int]:
        def work(job: int) -> int:
            mark = folder / "tried"
            if job == 3 and not mark.exists():
                mark.touch()
                os.kill(os.getpid(), number)
            return 2 * job

        return work

    return make


# --- in this process --------------------------------------------------------------------------------------------------------


def test_inline_ends_come_in_order_and_what_is_appended_is_done_too():
    jobs, results = deque([1, 2, 3]), []
    for end in run(doubled, jobs, Pool(), LONG):
        assert isinstance(end, Done)
        results.append(end.result)
        if end.job == 2:
            jobs.append(10)
    assert results == [2, 4, 6, 20]
    assert not jobs


def test_one_worker_is_inline_unless_ray_is_asked_for():
    assert pick_executor("auto", 1) == ("inline", 1)
    assert pick_executor("auto", 3) == ("ray", 3)
    assert pick_executor("inline", 3) == ("inline", 1)
    assert pick_executor("ray", 1) == ("ray", 1)


@pytest.mark.parametrize(("executor", "workers"), [("dask", 1), ("ray", 0), ("auto", 1)])
def test_a_pool_of_an_unknown_kind_or_of_nobody_is_refused(executor: str, workers: int):
    with pytest.raises(EngineError, match="use inline or ray and at least 1 worker"):
        Pool(executor, workers)


def test_a_cluster_that_is_not_there_is_one_line():
    for address, said in (("127.0.0.1:1", "no Ray cluster at 127.0.0.1:1"), ("ray://head:10001", "not host:port")):
        with pytest.raises(EngineError, match=said) as caught, session(Pool("ray", 1, address)):
            raise AssertionError
        assert "\n" not in str(caught.value)


def test_a_runtime_environment_that_ray_refuses_is_one_line():
    pool = Pool("ray", 1, "127.0.0.1:1", runtime_env={"env_vars": {"NUMBER": 1}})
    with pytest.raises(EngineError, match=r"^--runtime-env: .*env_vars") as caught, session(pool):
        raise AssertionError
    assert "\n" not in str(caught.value)


def test_the_second_worker_lost_on_the_same_try_is_one_too_many():
    strikes = Strikes(workers=1)
    assert [strikes.count_loss("slot", 0), strikes.count_loss("slot", 1), strikes.count_loss("slot", 1)] == [False, False, True]
    assert [strikes.count_loss("other"), strikes.count_loss("other")] == [False, True]


def test_losing_worker_after_worker_without_an_end_stops_the_run():
    strikes = Strikes(workers=1)
    for job in range(7):
        strikes.count_loss(job)
    strikes.clear()
    # one bad job is no reason to stop, however often it takes a worker
    for trying in range(30):
        strikes.count_loss("bad", trying)
    for job in range(6):
        strikes.count_loss(job)
    with pytest.raises(EngineError, match="8 jobs in a row lost their worker"):
        strikes.count_loss("last")


# --- on workers -------------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("ray_session")
@pytest.mark.parametrize("pool", [Pool(), Pool("ray", 1)], ids=["inline", "ray"])
def test_what_the_work_stands_on_is_out_of_garbage_collection_while_it_runs_and_no_longer(pool: Pool):
    before = gc.get_freeze_count()
    (end,) = run(frozen_objects, deque([0]), pool, LONG)
    assert isinstance(end, Done)
    assert end.result > 10_000 + before
    assert gc.get_freeze_count() <= before


@pytest.mark.usefixtures("ray_session")
def test_workers_do_every_job_once_and_what_is_appended_too():
    jobs, results = deque(range(40)), []
    for end in run(doubled, jobs, TWO, LONG):
        assert isinstance(end, Done)
        results.append((end.job, end.result))
        if end.job == 39:
            jobs.append(100)
    assert sorted(results) == [(i, 2 * i) for i in [*range(40), 100]]


@pytest.mark.usefixtures("ray_session")
def test_the_work_is_made_once_in_every_worker_and_workers_are_replaced_after_their_share():
    ends = list(run(named_process, deque(range(20)), Pool("ray", 2, recycle=4), LONG))
    results = [end.result for end in ends if isinstance(end, Done)]
    assert len(results) == 20
    per_process = Counter(pid for pid, _ in results)
    assert len(per_process) >= 5
    for pid, times in per_process.items():
        assert times <= 4
        assert sorted(count for process, count in results if process == pid) == list(range(1, times + 1))


@pytest.mark.usefixtures("ray_session")
@pytest.mark.parametrize(("number", "reason"), [(signal.SIGKILL, "worker_died"), (signal.SIGSTOP, "worker_hung")])
def test_a_lost_worker_is_replaced_and_its_job_can_be_tried_again(tmp_path: Path, number: int, reason: str):
    jobs, died, results = deque(range(8)), [], {}
    began = time.monotonic()
    for end in run(fatal_once(tmp_path, number), jobs, TWO, Limit(lambda _: 2.0)):
        match end:
            case Died(job, why):
                died.append((job, why))
                jobs.append(job)
            case Done(job, result):
                results[job] = result
    assert died == [(3, reason)]
    assert results == {i: 2 * i for i in range(8)}
    assert time.monotonic() - began < 30


@pytest.mark.usefixtures("ray_session")
def test_a_job_that_makes_headway_is_given_the_time_it_needs(tmp_path: Path):
    def make() -> Callable[[int], str]:
        def work(_: int) -> str:
            for step in range(10):
                (tmp_path / "step").write_text(str(step))
                time.sleep(0.3)
            return "through"

        return work

    def step(_: int) -> str:
        return (tmp_path / "step").read_text() if (tmp_path / "step").exists() else ""

    assert list(run(make, deque([0]), Pool("ray", 1), Limit(lambda _: 1.5, step))) == [Done(0, "through")]
    assert list(run(make, deque([0]), Pool("ray", 1), Limit(lambda _: 1.5))) == [Died(0, "worker_hung")]


@pytest.mark.usefixtures("ray_session")
def test_what_the_work_raises_is_raised_with_its_message():
    def make() -> Callable[[int], int]:
        def work(job: int) -> int:
            raise ValueError(f"job {job} has no such thing")

        return work

    def unmakable() -> Callable[[int], int]:
        raise LookupError("no weights here")

    with pytest.raises(ValueError, match=r"^job 7 has no such thing$"):
        list(run(make, deque([7]), TWO, LONG))
    with pytest.raises(LookupError, match="no weights here"):
        list(run(unmakable, deque([7]), TWO, LONG))


@pytest.mark.usefixtures("ray_session")
def test_a_run_whose_workers_cannot_start_ends():
    def make() -> Callable[[int], int]:
        os._exit(1)

    jobs = deque([1, 2])
    with pytest.raises(EngineError, match="no worker starts") as caught:
        list(run(make, jobs, TWO, LONG))
    assert "\n" not in str(caught.value)
    assert list(jobs) == [1, 2]


@pytest.mark.usefixtures("ray_session")
def test_closing_a_run_kills_its_workers_at_once(tmp_path: Path):
    def make() -> Callable[[int], int]:
        def work(job: int) -> int:
            (tmp_path / str(os.getpid())).touch()
            time.sleep(600 * (job > 0))
            return job

        return work

    with closing(run(make, deque([0, 1, 2, 3]), TWO, LONG)) as ends:
        assert next(ends) == Done(0, 0)
        began = time.monotonic()
    assert time.monotonic() - began < 10
    pids = [int(file.name) for file in tmp_path.iterdir()]
    assert pids
    assert not [pid for pid in pids if title(pid)]
