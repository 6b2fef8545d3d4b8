"""The one loop over jobs, and the one rule for lost workers.

Jobs share nothing, so scheduling changes no output byte.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pipeline.data.process.machine import freeze_garbage

from .contract import Check, Crew, CrewError, Died, Done, Make, RunningJob, result_of
from .ray_session import session

if TYPE_CHECKING:
    from .ray_workers import Workers


def run[J, R](
    make: Make[J, R],
    jobs: deque[J],
    crew: Crew,
    seconds: float,
    check: Check | None = None,
    lost: Callable[[], None] = lambda: None,
) -> Generator[Done[J, R] | Died[J], None, None]:
    """Yield the end of every job: in order when inline, else as they end.

    The caller may append to `jobs`. A worker gets its next job after its last was yielded. A worker
    that dies or hangs for `seconds` is replaced and its job tried again; a second loss on the same
    try yields Died.

    Close the iterator to kill the workers. Raises what the work raises, and CrewError.
    """
    if not jobs:
        return
    if crew.executor == "inline":
        if check is not None:
            check()
        work = make()
        with freeze_garbage():
            while jobs:
                job = jobs.popleft()
                yield Done(job, result_of(work(job)))
        return
    again, in_a_row = deque[RunningJob[J]](), set[RunningJob[J]]()
    with _hire(make, crew, seconds, check) as workers:
        while jobs or again or workers.at_work:
            for _ in range(workers.free(len(jobs) + len(again))):
                workers.give(RunningJob(jobs.popleft()) if jobs else again.popleft())
            for end in workers.ends():
                if isinstance(end, Done):
                    in_a_row.clear()
                    yield end
                    continue
                lost()
                task = end.task
                if end.reason == "node_lost":
                    again.append(task)
                    continue
                in_a_row.add(task)
                if len(in_a_row) >= 4 + 4 * crew.workers:
                    # recording them all as failed would blame the wrong thing
                    raise CrewError(
                        f"{len(in_a_row)} jobs in a row lost their worker, none ended: "
                        "is there memory for so many workers (--workers)?"
                    )
                task.losses[end.trying] += 1
                if task.losses[end.trying] < 2:
                    again.append(task)
                else:
                    in_a_row.clear()
                    yield Died(task.job, end.reason, end.trying, end.seconds)


@contextmanager
def _hire[J, R](
    make: Make[J, R], crew: Crew, seconds: float, check: Check | None
) -> "Iterator[Workers[J, R]]":
    with session(crew):
        # the session sets what Ray reads when it is imported
        from .ray_workers import Workers

        workers = Workers(make, crew, seconds, check)
        try:
            yield workers
        finally:
            workers.dismiss()
