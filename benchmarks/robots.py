"""Robots of others, added from files in published wheels: CPU seconds and lines of toml for each,
and what it accepts at level 1.

python -m benchmarks.robots --cache DIR --to LAB --layouts 3

The wheels are downloaded into the cache with pip (through `uvx`) and never become part of this
project. Files at `--cache` are used as they are, and so are robots that LAB, a directory of
plugins, has.
"""

import argparse
import subprocess
import sys
import time
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.robots.add import RobotOptions, add_robot
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.world.robots import register

TASKS = (
    *("adjust_bottle", "beat_block_hammer", "click_alarmclock", "click_bell", "move_can_pot"),
    *(
        "move_pillbottle_pad",
        "place_container_plate",
        "place_empty_cup",
        "place_mouse_pad",
        "shake_bottle",
    ),
)
LEVEL, ALPHA = 1, 0.1


@dataclass(frozen=True)
class Files:
    """A file in a wheel: the requirement, the Python of the wheel, the folder that is unpacked, the
    file in it."""

    wheel: str
    python: str
    folder: str
    name: str


@dataclass(frozen=True)
class Source:
    """A robot: its name here, its file, that of its gripper if this is another one, and the
    embodiments to try."""

    name: str
    arm: Files
    embodiments: tuple[str, ...]
    gripper: Files | None = None


def _skill(folder: str, name: str) -> Files:
    return Files("mani_skill==3.0.1", "3.12", f"mani_skill/assets/robots/{folder}", name)


def _suite(folder: str) -> Files:
    return Files(
        "robosuite==1.5.2", "3.12", f"robosuite/models/assets/robots/{folder}", "robot.xml"
    )


ROBOTIQ = Files(
    *("dm_robotics_moma==0.10.0", "3.10", "dm_robotics/moma/models/vendor"),
    "robotiq_beta_robots/mujoco/robotiq_2f85_v2.xml",
)
"""The Robotiq 2F-85 as DeepMind modelled it: the one in robosuite is no valid MJCF by itself."""

SOURCES = (
    Source("ur5e-robotiq", _suite("ur5e"), ("ur5e-robotiq",), ROBOTIQ),
    Source("kinova3-robotiq", _suite("kinova3"), ("kinova3-robotiq",), ROBOTIQ),
    Source("xarm7-robotiq", _suite("xarm7"), ("xarm7-robotiq",), ROBOTIQ),
    Source("ms-panda", _skill("panda", "panda_v2.urdf"), ("ms-panda",)),
    Source(
        "xarm6",
        Files("pybullet==3.2.7", "3.11", "pybullet_data/xarm", "xarm6_with_gripper.urdf"),
        ("none+xarm6",),
    ),
    Source("so100", _skill("so100", "so100.urdf"), ("so100", "so100+none")),
    Source("koch", _skill("koch", "follower_arm_v1.1.urdf"), ("koch",)),
)


def file_of(files: Files, cache: Path) -> Path:
    """A file from its wheel, downloaded and unpacked the first time."""
    if not (cache / files.folder).is_dir():
        wanted = [
            files.wheel,
            "--no-deps",
            "--only-binary=:all:",
            "--python-version",
            files.python,
            "--dest",
            str(cache),
        ]
        subprocess.run(["uvx", "pip", "download", *wanted], check=True, stdout=sys.stderr)
        (wheel,) = cache.glob(f"{files.wheel.split('==')[0]}-*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(
                cache, [name for name in archive.namelist() if name.startswith(f"{files.folder}/")]
            )
    return cache / files.folder / files.name


def add(source: Source, cache: Path, lab: Path) -> Path:
    """The directory of a robot, added if it is not there. Raises DominoError."""
    directory = lab / "robots" / source.name
    if directory.is_dir():
        return directory
    gripper = None if source.gripper is None else file_of(source.gripper, cache)
    return add_robot(
        file_of(source.arm, cache), RobotOptions(source.name, lab, gripper=gripper)
    ).directory


def yields(
    embodiment: str, tasks: Sequence[str], layouts: int
) -> Iterator[tuple[str, int, Counter[str]]]:
    """Task, accepted layouts of `layouts` fresh ones, and the reasons of the others."""
    for task in tasks:
        failed = Counter[str]()
        for seed in range(layouts):
            try:
                attempt(EpisodeSpec(task, embodiment, LEVEL, ALPHA, "clean", 0, seed), Recipe())
            except Failure as failure:
                failed[f"{failure.stage}: {failure.reason}"] += 1
        yield task, layouts - failed.total(), failed


def main() -> None:
    """Print both tables as they fill."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--to", type=Path, required=True)
    parser.add_argument("--robots", default=",".join(s.name for s in SOURCES))
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--layouts", type=int, default=3)
    given = parser.parse_args()
    tasks, chosen = (
        given.tasks.split(","),
        [s for s in SOURCES if s.name in given.robots.split(",")],
    )
    added: list[str] = []
    print("| robot | file | add (CPU s) | lines of robot.toml |\n|---|---|---:|---:|", flush=True)
    for source in chosen:
        began = time.process_time()
        try:
            directory = add(source, given.cache, given.to)
        except DominoError as error:
            print(
                f"| {source.name} | `{source.arm.name}` | refused:"
                f" {str(error).rpartition('/')[2]} | |",
                flush=True,
            )
            continue
        lines = len((directory / "robot.toml").read_text().splitlines())
        print(
            f"| {source.name} | `{source.arm.name}` | {time.process_time() - began:.1f} |"
            f" {lines} |",
            flush=True,
        )
        register(directory)
        added += source.embodiments
    print(
        f"\n| embodiment | {' | '.join(tasks)} | accepted |\n|---|{'---:|' * (len(tasks) + 1)}",
        flush=True,
    )
    reasons = list[str]()
    for embodiment in added:
        row = list(yields(embodiment, tasks, given.layouts))
        share = sum(done for _, done, _ in row) / (given.layouts * len(tasks))
        cells = " | ".join(f"{done}/{given.layouts}" for _, done, _ in row)
        print(f"| {embodiment} | {cells} | {100 * share:.0f} % |", flush=True)
        reasons += [f"{embodiment}, {task}: {dict(why)}" for task, _, why in row if why]
    print("\n" + "\n".join(reasons))


if __name__ == "__main__":
    main()
