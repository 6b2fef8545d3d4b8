"""Compile drawing's kernels during the first simulation: numba compiles one function at a time
in a process, and processes share its cache. Each kernel is compiled by one process.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from fcntl import LOCK_EX, flock
from pathlib import Path
from subprocess import DEVNULL, Popen
from sys import executable

import numpy as np

from pipeline.data.cameras import CAMERA_TYPES, Camera, look
from pipeline.data.process.machine import usable_cores
from pipeline.poses import pose
from pipeline.world.drawing.edges import through_lens
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.looks.visuals import CLEAN
from pipeline.world.shapes import Material, Mesh


def is_compiled() -> bool:
    """Whether numba's cache has the kernels: an image passes `through_lens` last."""
    code, folder = through_lens.py_func.__code__, _cache()
    name = f"{Path(code.co_filename).stem}.{through_lens.__name__}-{code.co_firstlineno}.*.nbi"
    return folder is not None and any(folder.glob(name))


def _cache() -> Path | None:
    folder = through_lens.stats.cache_path
    return Path(folder) if folder else None


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


def ensure_compiled() -> None:
    """Compile drawing's kernels, or wait for the process that compiles them now."""
    folder = _cache()
    if folder is None or is_compiled():
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "drawing.lock").open("a") as file:
        flock(file, LOCK_EX)  # until it is closed
        if not is_compiled():
            compile_drawing()


def compile_drawing() -> None:
    """Call each kernel that draws an episode of default looks, in order."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], np.float32)
    up = np.repeat(np.array([[0, 0, 1]], np.float32), 3, 0)
    parts = [(Mesh(corners, np.array([[0, 1, 2]], np.uint32), up), Material((0.5, 0.5, 0.5)))]
    here = pose((0.0, 0.0, 0.8))[None]
    kind = CAMERA_TYPES["L515"]
    camera = Camera("camera", kind, None, look((0.0, -0.5, 1.3), (0.0, 0.6, -0.6)))
    with Renderer({"body": parts}, [], [camera], CLEAN) as drawing:
        drawing.render({"body": here})


if __name__ == "__main__":
    ensure_compiled()
