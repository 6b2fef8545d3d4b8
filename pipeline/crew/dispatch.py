"""The engine: runs jobs in this process or on workers. A job is data, the work a function of it, its artifact a file.

Jobs are pure and write their own artifacts, so neither the executor nor the number of workers can change a byte of the output. The
engine knows no simulator and no dataset.
"""

from collections import deque
from collections.abc import Generator

from pipeline.crew.pool import Check, Died, Done, Limit, Make, Pool
from pipeline.memory import freeze_garbage


def run[J, R](
    make: Make[J, R], jobs: deque[J], pool: Pool, limit: Limit[J], gpus: bool = False, check: Check | None = None
) -> Generator[Done[J, R] | Died[J], None, None]:
    """Yield the end of every job: in order when inline, as they end on workers.

    `jobs` is emptied from the left. The caller may append to it while iterating, e.g. a job that died, to have it tried again; the
    run is over when it is empty and nothing runs. No worker is given a job before its last one was yielded, so a caller that is
    slow holds the workers up, and never more results wait than there are workers. `gpus` gives every worker an equal share of the
    GPUs there are, where the pool does not say how much. `check` is called on the machine of every worker. A worker that dies or
    hangs is replaced; inline there is nobody to notice either. Close the iterator (contextlib.closing) to stop at once: workers are
    killed, and nothing of this run is left behind.

    Raises what the work raises, and EngineError: also, naming the machine, if `check` raises or says other than elsewhere.
    """
    if not jobs:
        return
    if pool.executor == "inline":
        if check is not None:
            check()
        work = make()
        with freeze_garbage():
            while jobs:
                job = jobs.popleft()
                yield Done(job, work(job))
        return
    # Ray takes half a second to import
    from pipeline.crew.ray_workers import run_on_ray

    yield from run_on_ray(make, jobs, pool, limit, gpus, check)
