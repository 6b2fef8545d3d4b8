"""What 117,600 slots cost a build, its status and its report: the real build, index and crew around
a fake stage of 1 ms.

    python -m benchmarks.dataset_size [--episodes 112] [--out DIRECTORY] [--ray 16]

35 tasks on five robots at levels 1-3 in both domains are 1050 cells; `--episodes` of each. The
stage sleeps, writes an empty file in place of an episode and returns an entry with real keys, one
to three attempts and eleven assets. Every row of the table is a process of its own: seconds by the
clock and of its processor, and its peak of memory. `overhead` is what the driver spends on a slot
beyond the stage, by the clock, which on a busy machine counts the work of others; `processor ms` is
what a slot takes of the processor, stage included. `resume` grows the finished dataset by an
episode a cell: the time is that until the first of them begins. `index` records all slots in one
commit, and reads what `status` reads of them. The report has no films, because the files are no
episodes. The last rows build `--ray` episodes a cell with Ray workers, which are not replaced:
after 500 slots, when they would be, real ones have worked for half an hour.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

import pipeline.run.build as building
from benchmarks.hardware import hardware
from pipeline.annotate.overlays import annotation_sheet
from pipeline.crew.contract import Crew
from pipeline.data.dataset import Dataset
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.model import Recipe
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.files import Listing
from pipeline.data.slots.index import Index
from pipeline.data.slots.records import FileFacts, SlotRecord
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.names import recipe_from
from pipeline.run.slot.fill import FillJob

STAGE = 0.001
ROBOTS = "aloha-agilex,arx-x5,franka-panda,piper,ur5-wsg"
ASSETS = 60
SHA256 = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
STARTED = ".first"


def fake_worker(
    stage: float = STAGE, keys_of: Callable[[FillJob], SlotKeys] | None = None
) -> Callable[[FillJob], SlotRecord]:
    """The fake stage, in a process that knows its assets."""
    store, known = None, list[str]()

    def fill(job: FillJob) -> SlotRecord:
        nonlocal store
        began = time.perf_counter()
        dataset = Dataset(Path(job.root))
        if store is None:
            with suppress(FileExistsError), (dataset.root.parent / STARTED).open("x") as file:
                file.write(f"{time.process_time()}")
            store = AssetStore(dataset.bodies)
            known.extend(store.put({"x": np.full(8, n)}, {"n": n}) for n in range(ASSETS))
        time.sleep(stage)
        path, index = dataset.episode(job.slot), job.slot.index
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
        cell = vars(job.slot.cell) | {"slot": index}
        rows = [
            cell
            | {
                "attempt": n,
                "seed": job.recipe.spec(job.slot, n).seed,
                "outcome": "failed",
                "stage": "dry_run",
                "conditions": [],
            }
            | {
                "reason": "no_motion",
                "detail": (
                    f"workspace {job.recipe.spec(job.slot, n).seed % 997}, visibility 1, blocked"
                    f" {171 + index}"
                ),
                "sim_steps": 0,
                "seconds": 0.4,
            }
            for n in range(1 + index % 3)
        ]
        moved = dict.fromkeys(
            ("average_speed", "maximum_speed", "end_speed", "displacement"), 0.05 + 1e-4 * index
        )
        rows[-1] |= {
            "outcome": "accepted",
            "stage": "",
            "reason": "",
            "detail": "",
            "sim_steps": 900,
        } | moved
        facts = FileFacts.of(
            path.stat(), 75, SHA256[:32], [known[(index + n) % ASSETS] for n in range(11)]
        )
        spent = time.perf_counter() - began
        keys = keys_of(job) if keys_of else RecipeKeys(job.recipe).of(job.slot)
        return SlotRecord(keys, True, SHA256, tuple(rows), spent, file=facts)

    return fill


def step(name: str, root: Path, episodes: int) -> dict[str, float]:
    """One row, in this process."""
    began = time.time()
    recipe = make_recipe(episodes)
    building.fill_in_steps = fake_worker()
    first = root.parent / STARTED
    first.unlink(missing_ok=True)
    found: dict[str, float] = {}
    if name in ("build", "resume", "ray 1", "ray 2"):
        workers = int(name[-1]) if name.startswith("ray") else 1
        crew = Crew("ray", workers, recycle=10**6) if name.startswith("ray") else Crew()
        result = building.build(root, recipe, crew, shown="none")
        rows = Dataset(root).rows(recipe, "seconds")
        stage = rows.more["seconds"][np.argsort(rows.ids)][-result.made :]
        found["slots"] = result.made
        found["first job s"] = first.stat().st_mtime - began
        spent = float(stage.sum())
        found["overhead ms"] = (
            1000 * (time.time() - first.stat().st_mtime - spent / workers) / result.made
        )
        if workers == 1 and not name.startswith("ray"):
            found["processor ms"] = (
                1000 * (time.process_time() - float(first.read_text())) / result.made
            )
    if name == "report":
        page = refresh(Dataset(root), annotation_sheet)
        pages = [page, *(page.parent / "tasks").glob("*.html")]
        found["largest page kB"] = max(p.stat().st_size for p in pages) / 1000
    found["seconds"] = time.time() - began
    used = resource.getrusage(resource.RUSAGE_SELF)
    return found | {
        "processor s": used.ru_utime + used.ru_stime,
        "memory MB": used.ru_maxrss / 1000,
    }


def fill_index(root: Path, episodes: int) -> dict[str, float]:
    """Record all slots in one commit, without a build; then what reading them takes of the
    processor."""
    recipe, dataset = make_recipe(episodes), Dataset(root)
    dataset.create(recipe)
    keys, fill = RecipeKeys(recipe), fake_worker(0.0, lambda job: keys.of(job.slot))
    with IndexWriter(dataset, recipe) as writer:
        writer.index.add(
            (slot, fill(FillJob(str(root), recipe, slot))) for slot in recipe.physical_slots()
        )
    began = time.process_time()
    with Index(dataset.index) as index:
        rows = index.rows(recipe)
        index.attempts(rows, "stage", "reason", "detail", "conditions")
    read = time.process_time() - began
    Listing(dataset.episodes, recipe).there(rows)
    listed = time.process_time() - began - read
    return {
        "slots": len(rows),
        "read s": read,
        "listing s": listed,
        "index MB": dataset.index.stat().st_size / 1e6,
    }


def make_recipe(episodes: int) -> Recipe:
    """All tasks on all robots in both domains."""
    return recipe_from(
        {"embodiments": ROBOTS.split(","), "domains": ["clean", "randomized"], "episodes": episodes}
    )


def status(root: Path) -> dict[str, float]:
    """The command itself, from start to end."""
    began = time.time()
    subprocess.run(
        [sys.executable, "-m", "pipeline.cli", "status", root],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "seconds": time.time() - began,
        "processor s": used.ru_utime + used.ru_stime,
        "memory MB": used.ru_maxrss / 1000,
    }


COLUMNS = (
    *(
        "slots",
        "read s",
        "listing s",
        "index MB",
        "seconds",
        "processor s",
        "first job s",
        "overhead ms",
        "processor ms",
    ),
    *("largest page kB", "memory MB"),
)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=112)
    parser.add_argument(
        "--ray", type=int, default=16, help="episodes a cell of the builds with Ray"
    )
    parser.add_argument(
        "--out", type=Path, default=None, help="directory for the datasets, kept afterwards"
    )
    parser.add_argument("--step", default="")
    given = parser.parse_args()
    if given.step:
        others = {
            "status": lambda: status(given.out),
            "index": lambda: fill_index(given.out, given.episodes),
        }
        found = (
            others[given.step]()
            if given.step in others
            else step(given.step, given.out, given.episodes)
        )
        print(json.dumps(found))
        return
    with tempfile.TemporaryDirectory() as folder:
        base = given.out or Path(folder)
        base.mkdir(parents=True, exist_ok=True)
        rows = [
            ("index", "index", given.episodes),
            ("build", "data", given.episodes),
            ("status", "data", 0),
            ("resume", "data", given.episodes + 1),
        ]
        rows += [
            ("report", "data", given.episodes + 1),
            ("ray 1", "ray-1", given.ray),
            ("ray 2", "ray-2", given.ray),
        ]
        print(hardware())
        print(f"\n| | {' | '.join(COLUMNS)} |\n|---|{'---:|' * len(COLUMNS)}")
        for name, place, episodes in rows:
            command = [
                sys.executable,
                "-m",
                "benchmarks.dataset_size",
                "--step",
                name,
                "--out",
                base / place,
            ]
            done = subprocess.run(
                [*command, "--episodes", str(episodes)],
                check=True,
                stdout=subprocess.PIPE,
                text=True,
            )
            found = json.loads(done.stdout.splitlines()[-1])
            print(
                f"| {name} |"
                f" {' | '.join(f'{found[c]:.6g}' if c in found else '' for c in COLUMNS)} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
