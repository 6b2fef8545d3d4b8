"""The loop on fake work: every job ends once, whatever becomes of its worker."""

import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import pytest

from pipeline.crew.contract import Crew, CrewError, Died, Done, RunningJob, Steps, pick_executor
from pipeline.crew.loop import run
from pipeline.crew.ray_session import session
from pipeline.crew.ray_workers import LostJob
from tests.run.processes import title, wait_for

TWO = Crew("ray", 2)
LONG = 60.0


def double() -> Callable[[int], int]:
    return lambda job: 2 * job


def count_jobs() -> Callable[[int], tuple[int, int]]:
    """The work returns which process did it and how many times this one was made."""
    made = []

    def work(_: int) -> tuple[int, int]:
        made.append(1)
        return os.getpid(), len(made)

    return work


def signal_itself(
    folder: Path, number: int, times: int
) -> Callable[[], Callable[[int], Steps[int]]]:
    """Work in three steps that sends its process a signal in step 1 of job 3, so many times."""

    def make() -> Callable[[int], Steps[int]]:
        def work(job: int) -> Steps[int]:
            for step in range(3):
                yield step
                marks = len(list(folder.iterdir()))
                if job == 3 and step == 1 and marks < times:
                    (folder / str(marks)).touch()
                    os.kill(os.getpid(), number)
            return 2 * job

        return work

    return make


def test_inline_ends_come_in_order_and_what_is_appended_is_done_too(tmp_path: Path):
    jobs, results = deque([1, 2, 3]), []
    for end in run(signal_itself(tmp_path, signal.SIGKILL, 0), jobs, Crew(), LONG):
        assert isinstance(end, Done)
        results.append(end.result)
        if end.job == 2:
            jobs.append(10)
    assert results == [2, 4, 6, 20]
    assert not jobs


def test_one_worker_is_inline_unless_ray_is_asked_for():
    assert pick_executor("auto", 1) == ("inline", 1)
    assert pick_executor("auto", 3) == ("ray", 3)
    assert pick_executor("auto", 3, 2) == ("ray", 3)
    assert pick_executor("auto", None, 2) == ("inline", 1)
    assert pick_executor("auto", None, 3) == pick_executor("auto", None)
    assert pick_executor("inline", 3) == ("inline", 1)
    assert pick_executor("ray", 1) == ("ray", 1)


@pytest.mark.parametrize(("executor", "workers"), [("dask", 1), ("ray", 0), ("auto", 1)])
def test_a_crew_of_an_unknown_kind_or_of_nobody_is_refused(executor: str, workers: int):
    with pytest.raises(CrewError):
        Crew(executor, workers)


class Unlucky:
    """Workers that end as a script says: one reason for each end, "" for done."""

    def __init__(self, reasons: Iterator[tuple[str, Hashable]]):
        self.reasons, self.tasks, self.tried = reasons, deque[RunningJob[int]](), list[int]()

    @property
    def at_work(self) -> int:
        return len(self.tasks)

    def free(self, waiting: int) -> int:
        return min(waiting, 2 - len(self.tasks))

    def give(self, task: RunningJob[int]) -> None:
        self.tasks.append(task)
        self.tried.append(task.job)

    def ends(self) -> Iterator[Any]:
        task, (reason, trying) = self.tasks.popleft(), next(self.reasons)
        yield LostJob(task, reason, trying, 1.5) if reason else Done(task.job, -task.job)


def run_unlucky(
    monkeypatch: pytest.MonkeyPatch, jobs: list[int], *reasons: tuple[str, Hashable]
) -> tuple[list[Any], list[int]]:
    """The ends of a run, and the jobs in the order in which they were given to workers."""
    workers = Unlucky(iter(reasons))
    monkeypatch.setattr("pipeline.crew.loop._hire", lambda *_: nullcontext(workers))
    return list(run(double, deque(jobs), Crew("ray", 1), LONG)), workers.tried


def test_the_second_loss_on_the_same_try_is_one_too_many(monkeypatch: pytest.MonkeyPatch):
    losses = [("worker_died", 0), ("worker_died", 1), ("worker_hung", 1)]
    ends, _ = run_unlucky(monkeypatch, [7], *losses)
    assert ends == [Died(7, "worker_hung", 1, 1.5)]


def test_a_job_is_tried_again_after_the_others(monkeypatch: pytest.MonkeyPatch):
    ends, tried = run_unlucky(monkeypatch, [1, 2, 3], ("worker_died", None), *[("", None)] * 3)
    assert tried == [1, 2, 3, 1]
    assert ends == [Done(2, -2), Done(3, -3), Done(1, -1)]


def test_a_machine_that_leaves_is_no_fault_of_its_jobs(monkeypatch: pytest.MonkeyPatch):
    ends, _ = run_unlucky(monkeypatch, [7], *[("node_lost", 0)] * 9, ("worker_died", 0), ("", 0))
    assert ends == [Done(7, -7)]


def test_different_jobs_in_a_row_that_lose_their_worker_end_the_run(
    monkeypatch: pytest.MonkeyPatch,
):
    # one bad job is no reason to stop, however often it takes a worker
    died, done = ("worker_died", 0), ("", 0)
    ends, _ = run_unlucky(monkeypatch, list(range(8)), *[died] * 7, done, *[died] * 7)
    assert [type(end) for end in ends] == [Done, *[Died] * 7]
    with pytest.raises(CrewError, match="8 jobs in a row lost their worker"):
        run_unlucky(monkeypatch, list(range(8)), *[died] * 8)


def test_a_cluster_that_is_not_there_is_one_line():
    expected = (
        ("127.0.0.1:1", "no Ray cluster at 127.0.0.1:1"),
        ("ray://head:10001", "not host:port"),
    )
    for address, message in expected:
        with pytest.raises(CrewError, match=message) as caught, session(Crew("ray", 1, address)):
            raise AssertionError
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("variables", [{"NUMBER": 1}, None, ["a"]])
def test_a_runtime_environment_that_ray_refuses_is_one_line(variables):
    crew = Crew("ray", 1, "127.0.0.1:1", runtime_env={"env_vars": variables})
    with pytest.raises(CrewError, match=r"^--runtime-env: ") as caught, session(crew):
        raise AssertionError
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("ray_session")
def test_workers_do_every_job_once_and_what_is_appended_too_off_the_main_thread_as_well():
    results = []

    def work() -> None:
        jobs = deque(range(40))
        for end in run(double, jobs, TWO, LONG):
            assert isinstance(end, Done)
            results.append((end.job, end.result))
            if end.job == 39:
                jobs.append(100)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert sorted(results) == [(i, 2 * i) for i in [*range(40), 100]]


@pytest.mark.usefixtures("ray_session")
def test_the_work_is_made_once_in_every_worker_and_workers_are_replaced_after_their_share():
    ends = list(run(count_jobs, deque(range(20)), Crew("ray", 2, recycle=4), LONG))
    results = [end.result for end in ends if isinstance(end, Done)]
    assert len(results) == 20
    per_process = Counter(pid for pid, _ in results)
    assert len(per_process) >= 5
    for pid, times in per_process.items():
        assert times <= 4
        counts = sorted(count for process, count in results if process == pid)
        assert counts == list(range(1, times + 1))


@pytest.mark.usefixtures("ray_session")
def test_a_job_that_is_killed_or_hangs_twice_on_a_try_died_and_the_others_are_done(tmp_path: Path):
    for number, reason in ((signal.SIGKILL, "worker_died"), (signal.SIGSTOP, "worker_hung")):
        folder, lost = tmp_path / reason, []
        folder.mkdir()
        make = signal_itself(folder, number, 2)
        ends = list(run(make, deque(range(5)), TWO, 2.0, lost=lambda lost=lost: lost.append(1)))
        assert len(lost) == 2
        (died,) = [end for end in ends if isinstance(end, Died)]
        assert (died.job, died.reason, died.trying) == (3, reason, 1)
        assert died.seconds >= 2 * (number == signal.SIGSTOP)
        results = {end.job: end.result for end in ends if isinstance(end, Done)}
        assert results == {i: 2 * i for i in range(5) if i != 3}


@pytest.mark.usefixtures("ray_session")
def test_a_job_whose_steps_go_on_is_given_the_time_it_needs():
    def make() -> Callable[[int], Steps[str]]:
        def work(job: int) -> Steps[str]:
            for step in range(6):
                if job == 0:
                    yield step
                time.sleep(0.5)
            return "through"

        return work

    found = {end.job: end for end in run(make, deque([0, 1]), TWO, 1.5)}
    assert found[0] == Done(0, "through")
    assert isinstance(found[1], Died) and found[1].reason == "worker_hung"


@pytest.mark.usefixtures("ray_session")
def test_what_the_work_raises_is_raised_with_its_message():
    def make() -> Callable[[int], int]:
        def work(job: int) -> int:
            raise ValueError(f"job {job} has no such thing")

        return work

    def fail() -> Callable[[int], int]:
        raise LookupError("no weights here")

    with pytest.raises(ValueError, match=r"^job 7 has no such thing$"):
        list(run(make, deque([7]), TWO, LONG))
    with pytest.raises(LookupError, match="no weights here"):
        list(run(fail, deque([7]), TWO, LONG))


@pytest.mark.usefixtures("ray_session")
def test_a_run_whose_workers_cannot_start_ends():
    def make() -> Callable[[int], int]:
        os._exit(1)

    jobs = deque([1, 2])
    with pytest.raises(CrewError, match="no worker starts") as caught:
        list(run(make, jobs, TWO, LONG))
    assert "\n" not in str(caught.value)
    assert list(jobs) == [1, 2]


@pytest.mark.usefixtures("ray_session")
def test_closing_a_run_kills_its_workers(tmp_path: Path):
    def make() -> Callable[[int], int]:
        def work(job: int) -> int:
            (tmp_path / str(os.getpid())).touch()
            time.sleep(600 * (job > 0))
            return job

        return work

    with closing(run(make, deque([0, 1, 2, 3]), TWO, LONG)) as ends:
        assert next(ends) == Done(0, 0)
    pids = [int(file.name) for file in tmp_path.iterdir()]
    assert pids
    wait_for(lambda: not [pid for pid in pids if title(pid)], 20)
