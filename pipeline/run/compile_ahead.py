"""Compile drawing's kernels during the first simulation: numba compiles one function at a time
in a process, and processes share its cache.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, Popen
from sys import executable

import numpy as np

from pipeline.data.cameras import CAMERA_TYPES, Camera, look
from pipeline.data.process.machine import usable_cores
from pipeline.poses import IDENTITY
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.silhouettes import draw, occluders_of, track_bodies
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.shapes import Material, Mesh


def is_compiled() -> bool:
    """Whether numba's cache has the kernels: `draw` is compiled last but for its caller."""
    code, folder = draw.py_func.__code__, draw.stats.cache_path
    name = f"{Path(code.co_filename).stem}.{draw.__name__}-{code.co_firstlineno}.*.nbi"
    return bool(folder) and any(Path(folder).glob(name))


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """Within, a process compiles drawing's kernels if a second core can run it."""
    if usable_cores() < 2 or is_compiled():
        yield
        return
    command = [executable, "-P", "-m", __name__]
    process = Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def compile_drawing() -> None:
    """Call each kernel of an episode of default looks, in order."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], np.float32)
    up = np.repeat(np.array([[0, 0, 1]], np.float32), 3, 0)
    parts = [(Mesh(corners, np.array([[0, 1, 2]], np.uint32), up), Material((0.5, 0.5, 0.5)))]
    here = IDENTITY[None]
    kind = CAMERA_TYPES["L515"]
    camera = Camera("camera", kind, None, look((0.0, -0.5, 1.3), (0.0, 0.6, -0.6)))
    with Renderer({"body": parts}, [], [camera], CLEAN) as drawing:
        drawing.render({"body": here})
    solids = occluders_of({"body": parts}, [])
    track_bodies(solids, {"body": here}, ["body"], kind, here)


if __name__ == "__main__":
    compile_drawing()
