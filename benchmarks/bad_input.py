"""Bad input: how many command lines are refused in one line, with exit code 2 and nothing changed; time and memory they take.

python -m benchmarks.bad_input [--all]
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from tests.commands.bad_input import CASES, attempt
from tests.commands.bad_places import furnish


def main() -> None:
    """Try every case and print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="print every command line and what it answers")
    every = parser.parse_args().all
    kept: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    faults, seconds, megabytes = [], 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        furnish(Path(folder))
        for case in CASES:
            outcome = attempt(case, Path(folder))
            fault, verb = outcome.fault(case), case.words[0]
            tried[verb] += 1
            kept[verb] += not fault
            seconds, megabytes = max(seconds, outcome.seconds), max(megabytes, outcome.megabytes)
            if fault:
                faults.append(f"FAIL domino-data {case.name}: {fault}")
            if every:
                print(f"domino-data {case.name}\n    {outcome.err.strip()}")
    print("| command | cases | one line, exit code 2, nothing changed |\n|---|---|---|")
    for verb, count in sorted(tried.items()):
        print(f"| {verb} | {count} | {kept[verb]} |")
    print(f"| all | {len(CASES)} | {sum(kept.values())} |")
    print(f"\nslowest {seconds:.1f} s (imports included), largest growth of the process {megabytes:.0f} MB")
    print("\n".join(faults))


if __name__ == "__main__":
    main()
