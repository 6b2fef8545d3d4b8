"""The engine: runs jobs in this process or on workers. A job is data, the work a function of it, its artifact a file.

Jobs are pure and write their own artifacts, so neither the executor nor the number of workers can change a byte of the output. The
engine knows no simulator and no dataset.
"""

from collections import deque
from collections.abc import Generator

from pipeline.run.pool import Died, Done, Limit, Make, Pool


def run[J, R](
    make: Make[J, R], jobs: deque[J], pool: Pool, limit: Limit[J], gpus: bool = False
) -> Generator[Done[J, R] | Died[J], None, None]:
    """Yield the end of every job: in order when inline, as they end on workers.

    `jobs` is emptied from the left. The caller may append to it while iterating, e.g. a job that died, to have it tried again; the
    run is over when it is empty and nothing runs. `gpus` gives every worker an equal share of the GPUs there are. A worker that
    dies or hangs is replaced; inline there is nobody to notice either. Close the iterator (contextlib.closing) to stop at once:
    workers are killed, and nothing of this run is left behind.

    Raises what the work raises, and EngineError.
    """
    if not jobs:
        return
    if pool.executor == "inline":
        work = make()
        while jobs:
            job = jobs.popleft()
            yield Done(job, work(job))
        return
    # Ray takes half a second to import
    from pipeline.run.ray_engine import run_on_ray

    yield from run_on_ray(make, jobs, pool, limit, gpus)
