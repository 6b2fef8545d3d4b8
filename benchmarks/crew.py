"""What the crew itself costs: jobs that only sleep, against the time they sleep.

    python -m benchmarks.crew [--jobs 5000] [--milliseconds 1] [--workers 1,2]

`start` is the time until the first job has ended (Ray, workers and their imports), `stop` that from
the last to a clean machine. The overhead is what one worker spends on a job beyond sleeping.
Workers are kept, or replaced after so many jobs, as in a build, which costs a start each time.
"""

import argparse
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from functools import partial

from benchmarks.hardware import hardware
from pipeline.crew.contract import Crew, Done
from pipeline.crew.loop import run


def sleeper(seconds: float) -> Callable[[int], int]:
    """Work that takes so long, by the clock, and uses no processor to speak of."""

    def work(job: int) -> int:
        time.sleep(seconds)
        return job

    return work


def measure(jobs: int, seconds: float, crew: Crew) -> list[str]:
    """A row of the table."""
    began = first = last = time.perf_counter()
    with closing(run(partial(sleeper, seconds), deque(range(jobs)), crew, 60.0)) as ends:
        for number, end in enumerate(ends):
            assert isinstance(end, Done)
            last = time.perf_counter()
            first = first if number else last
    stopped = time.perf_counter()
    each = (last - first) / (jobs - 1)
    overhead = each * crew.workers - seconds
    numbers = (1000 * each, 1000 * overhead)
    kept = "kept" if crew.recycle > jobs else f"after {crew.recycle}"
    return [
        crew.executor,
        str(crew.workers),
        kept,
        *(f"{n:.2f}" for n in numbers),
        f"{first - began:.1f}",
        f"{stopped - last:.1f}",
    ]


def slept(seconds: float, times: int = 200) -> float:
    """What such a sleep really takes."""
    began = time.perf_counter()
    for _ in range(times):
        time.sleep(seconds)
    return (time.perf_counter() - began) / times


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--jobs", type=int, default=5000)
    parser.add_argument("--milliseconds", type=float, default=1.0)
    parser.add_argument("--workers", default="1,2", help="numbers of workers, comma separated")
    given = parser.parse_args()
    seconds = given.milliseconds / 1000
    print(hardware())
    print(
        f"{given.jobs} jobs of {given.milliseconds:g} ms, which take {1000 * slept(seconds):.2f}"
        " ms\n"
    )
    head = ["executor", "workers", "replaced", "ms a job", "overhead ms", "start s", "stop s"]
    print(f"| {' | '.join(head)} |\n|---|{'---:|' * (len(head) - 1)}")
    counts = [int(n) for n in given.workers.split(",")]
    kept = given.jobs + 1
    for crew in [
        Crew(recycle=kept),
        *(Crew("ray", n, recycle=r) for n in counts for r in (kept, Crew().recycle)),
    ]:
        print(f"| {' | '.join(measure(given.jobs, seconds, crew))} |")


if __name__ == "__main__":
    main()
