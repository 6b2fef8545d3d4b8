"""Objects of others, added by one command each and caught at level 1: `python -m
benchmarks.real_objects FILES --to DIR`.

FILES holds what the wheels robosuite 1.5.2, pybullet 3.2.7 and mani_skill 3.0.1 contain (`pip
download --no-deps WHEEL`, then unzip; nothing is installed). Prints for each object the seconds
that adding it takes, its pieces and grasps, and how many of the attempts at fresh layouts of a task
each robot accepts. Physics only.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.hardware import hardware
from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.objects.add import add_objects
from pipeline.intake.objects.draft import Options
from pipeline.plugins import load_plugins, use_plugins
from pipeline.run.names import resolve
from pipeline.stages.attempt import Phases, attempt
from pipeline.stages.failure import Failure
from pipeline.world.objects.contract import FAMILIES

ROBOTS = ("aloha-agilex", "franka-panda", "ur5-wsg")


@dataclass(frozen=True)
class Real:
    """A mesh below FILES, what it is called, the family that it stands for, the task that catches
    it, its scale and up axis."""

    file: str
    name: str
    family: str
    task: str
    scale: float = 1.0
    up: str | None = None


SUITE, BULLET, SKILL = (
    "robosuite/models/assets/objects/meshes",
    "pybullet_data",
    "mani_skill/envs/tasks",
)
AWAY, CARDS = "move_playingcard_away", "playing_cards"
REAL = (
    Real(f"{SUITE}/can.obj", "soda_can", "can", "place_can_basket"),
    Real(f"{SUITE}/milk.obj", "milk", "pill_bottle", "move_pillbottle_pad", 0.9),
    Real(f"{SUITE}/bread.obj", "bread_loaf", "bread", "place_bread_basket", 0.8),
    Real(f"{SUITE}/cereal.obj", "cereal", CARDS, AWAY, 1.0, "z"),
    Real(f"{SUITE}/lemon.obj", "lemon", "bread", "place_bread_basket"),
    Real(f"{SUITE}/bottle.obj", "glass_bottle", "lying_bottle", "adjust_bottle"),
    Real(f"{SUITE}/cylinder.obj", "rod", "pill_bottle", "move_pillbottle_pad", 0.03),
    Real(f"{SUITE}/cube.obj", "cube_5cm", CARDS, AWAY, 0.05),
    Real(f"{BULLET}/objects/mug.obj", "plain_mug", "cup", "place_empty_cup", 1.0, "z"),
    Real(f"{BULLET}/duck.obj", "duck", CARDS, AWAY, 0.05, "y"),
    Real(f"{BULLET}/soccerball.obj", "soccer_ball", CARDS, AWAY, 0.06),
    Real(f"{BULLET}/lego/lego.obj", "lego_brick", CARDS, AWAY, 0.15),
    Real(f"{BULLET}/jenga/jenga.obj", "jenga_block", CARDS, AWAY, 0.05),
    Real(f"{BULLET}/domino/domino.obj", "domino_tile", CARDS, AWAY, 1.5, "z"),
    Real(f"{BULLET}/torus/torus_textured.obj", "ring", CARDS, AWAY, 0.04),
    Real(f"{BULLET}/toys/prism.obj", "prism", CARDS, AWAY, 0.6),
    Real(f"{BULLET}/toys/cylinder.obj", "toy_cylinder", CARDS, AWAY, 0.6),
    Real(f"{BULLET}/bunny.obj", "bunny", CARDS, AWAY, 0.04),
    Real(
        f"{BULLET}/tray/tray_textured4.obj", "tray", "bread_basket", "place_bread_basket", 0.15, "z"
    ),
    Real(f"{SKILL}/humanoid/assets/apple_1.glb", "apple", "bread", "place_bread_basket", 0.7),
    Real(f"{SKILL}/fmb/assets/purple_u.glb", "purple_u", CARDS, AWAY),
    Real(f"{SKILL}/fmb/assets/green_bridge.glb", "green_bridge", CARDS, AWAY),
)


def accepted(one: Real, robot: str, tries: int) -> int:
    """How many of so many attempts at fresh layouts, level 1, are accepted."""
    recipe = resolve(
        Recipe(tasks=(one.task,), embodiments=(robot,), objects={one.family: (one.name,)})
    )
    count = 0
    for seed in range(tries):
        try:
            attempt(
                EpisodeSpec(one.task, robot, 1, 0.1, "clean", seed, 9000 + seed), recipe, Phases()
            )
            count += 1
        except Failure as failure:
            print(f"    {one.name} {robot} {seed}: {failure.stage} {failure.reason}", flush=True)
    return count


def added(one: Real, files: Path, to: Path) -> float | None:
    """Seconds that adding an object takes; None where it is refused."""
    before = time.monotonic()
    try:
        add_objects(
            files / one.file,
            Options(one.name, one.family, to, up=one.up, scale=one.scale, within=files),
        )
    except DominoError as error:
        print(f"    {one.name}: {error}", flush=True)
        return None
    return time.monotonic() - before


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path)
    parser.add_argument("--to", type=Path, required=True)
    parser.add_argument("--tries", type=int, default=5)
    parser.add_argument("--names", default="")
    options = parser.parse_args(arguments)
    options.to.mkdir(parents=True, exist_ok=True)
    use_plugins([str(options.to)])
    load_plugins()
    print(hardware())
    print("| object | stands for | s | pieces | grasps | task | " + " | ".join(ROBOTS) + " |")
    for one in REAL:
        if options.names and one.name not in options.names.split(","):
            continue
        seconds = 0.0 if one.name in FAMILIES else added(one, options.files, options.to)
        if seconds is None:
            continue
        instance = FAMILIES[one.name].draw(np.random.default_rng(0))
        counts = (
            [f"{accepted(one, robot, options.tries)}/{options.tries}" for robot in ROBOTS]
            if options.tries
            else []
        )
        shape, grasps = instance.shape(), instance.frames().grasps
        cells = (
            one.name,
            one.family,
            f"{seconds:.0f}",
            len(shape.collision),
            len(grasps),
            one.task,
            *counts,
        )
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
