"""Where the time of our own rasteriser goes, by pass.

    python -m benchmarks.passes [--scenes click_bell:aloha ...] [--repeats 5]

An episode of every scene is rolled out and drawn as in `benchmarks.rendering`. Milliseconds are of
this thread's processor time per instant of three cameras, the least of all repeats. "rest" is what
Python and numpy do around the passes.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from benchmarks.hardware import hardware
from benchmarks.rendering import rolled_out, size
from pipeline.stages.drawing.render import renderer
from pipeline.world.drawing import renderer as drawing
from pipeline.world.drawing import shadows
from pipeline.world.drawing.software import casters, scene

SCENES = ("click_bell:aloha", "grab_roller:aloha", "place_object_basket@randomized:arx")
PASSES = {
    "room, visibility": (scene, "fill_quads"),
    "bodies, visibility": (scene, "fill_bodies"),
    "pixels that changed": (scene, "sort_stale"),
    "room, light": (scene, "shade_plane"),
    "bodies, light": (scene, "shade_bodies"),
    "shadow map": (casters, "fill_depths"),
    "least and most depths": (casters, "surrounding"),
    "blocks that changed": (shadows, "compare"),
    "edges": (drawing, "smoothed"),
    "lens": (drawing, "through_lens"),
}


def timed(pass_: Callable[..., Any], spent: dict[str, float], name: str) -> Callable[..., Any]:
    """The pass, adding its seconds under a name."""

    def run(*given: Any) -> Any:
        began = time.thread_time()
        result = pass_(*given)
        spent[name] += time.thread_time() - began
        return result

    return run


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    spent = defaultdict[str, float](float)
    jobs = {name: rolled_out(name) for name in given.scenes}
    for name, (module, kernel) in PASSES.items():
        setattr(module, kernel, timed(getattr(module, kernel), spent, name))
    table = dict[str, dict[str, float]]()
    for scene_name, job in jobs.items():
        with renderer(job.appearance) as opened:
            opened.render(job.poses)
            least = defaultdict[str, float](lambda: 1e9)
            for _ in range(given.repeats):
                spent.clear()
                began = time.thread_time()
                opened.render(job.poses)
                spent["all"] = time.thread_time() - began
                spent["rest"] = 2 * spent["all"] - sum(spent.values())
                for part, seconds in spent.items():
                    least[part] = min(least[part], seconds)
            instants = len(next(iter(job.poses.values())))
            table[scene_name] = {part: 1000 * s / instants for part, s in least.items()}
    print(f"{hardware()}\n")
    print(f"| ms an instant | {' | '.join(f'{n}, {size(jobs[n])}' for n in table)} |")
    print("|---|" + "---:|" * len(table))
    for part in (*PASSES, "rest", "all"):
        print(f"| {part} | {' | '.join(f'{of[part]:.2f}' for of in table.values())} |")


if __name__ == "__main__":
    main()
