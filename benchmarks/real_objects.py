"""Yields of fetched objects beside those of the families that they stand for: `python -m
benchmarks.real_objects PLUGINS`.

PLUGINS is the directory that `domino-data objects fetch` filled. Counts how many of the attempts at
fresh layouts of a task are accepted at level 1 (alpha 0.1, clean). Physics only.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.hardware import hardware
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.fetch_objects import WHEELS, read_catalogue
from pipeline.plugins import load_plugins, use_plugins
from pipeline.run.names import resolve
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.world.objects.contract import FAMILIES

TASKS = {
    "bottle": "shake_bottle",
    "bowl": "place_container_plate",
    "bread": "place_bread_skillet",
    "bread_basket": "place_bread_basket",
    "can": "place_can_basket",
    "coffee_box": "place_a2b_left",
    "cup": "place_empty_cup",
    "mug": "hanging_mug",
    "pill_bottle": "move_pillbottle_pad",
    "play_ball": "stop_rolling_ball",
    "playing_cards": "move_playingcard_away",
    "sauce_can": "move_can_pot",
    "soap": "place_a2b_left",
    "tea_box": "scan_object",
    "toy_car": "place_object_stand",
    "wooden_block": "place_a2b_left",
}
"""The task in which an object of each family is tried."""


def accepted(task: str, recipe: Recipe, name: str, tries: int) -> int:
    """How many of so many attempts at fresh layouts with an object of a family are accepted."""
    count, seed = 0, 9000
    for _ in range(tries):
        while name not in families_of(spec := layout(task, recipe.embodiments[0], seed), recipe):
            seed += 1
        seed += 1
        try:
            attempt(spec, recipe)
            count += 1
        except Failure as failure:
            print(f"# {task} {name} {spec.seed}: {failure.stage} {failure.reason}", flush=True)
    return count


def layout(task: str, robot: str, seed: int) -> EpisodeSpec:
    """The spec of a seed at level 1 in the clean domain."""
    return EpisodeSpec(task, robot, 1, 0.1, "clean", seed, seed)


def families_of(spec: EpisodeSpec, recipe: Recipe) -> set[str]:
    """The families of the bodies of a layout; none where they do not fit."""
    try:
        return {body.family for body in build_scene(spec, recipe.ruling()).bodies.values()}
    except Failure:
        return set()


def main() -> None:
    """Print the table as CSV."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plugins", type=Path)
    parser.add_argument("--robot", default="aloha-agilex")
    parser.add_argument("--tries", type=int, default=5)
    given = parser.parse_args()
    use_plugins([str(given.plugins)])
    load_plugins()
    print(hardware())
    print("object,source,stands for,pieces,grasps,task,attempts,accepted,family accepted")
    families = dict[str, int]()
    for source in WHEELS:
        for one in read_catalogue(source):
            if one.name not in FAMILIES:
                continue
            task = TASKS[one.family]
            if one.family not in families:
                recipe = resolve(Recipe(tasks=(task,), embodiments=(given.robot,)))
                families[one.family] = accepted(task, recipe, one.family, given.tries)
            objects = {one.family: (one.name,)}
            recipe = resolve(Recipe(tasks=(task,), embodiments=(given.robot,), objects=objects))
            count = accepted(task, recipe, one.name, given.tries)
            instance = FAMILIES[one.name].draw(np.random.default_rng(0))
            pieces, grasps = len(instance.shape().collision), len(instance.frames().grasps)
            cells = (one.name, source, one.family, pieces, grasps, task, given.tries, count)
            print(",".join(map(str, (*cells, families[one.family]))), flush=True)


if __name__ == "__main__":
    main()
