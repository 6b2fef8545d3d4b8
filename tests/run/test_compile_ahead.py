"""Kernels that are compiled beside the first simulation."""

import os
import subprocess
import sys
import time

from pipeline.run import compile_ahead
from pipeline.run.compile_ahead import compiling_ahead, is_compiled
from pipeline.world.drawing import edges, masks, surfaces
from pipeline.world.drawing.software import casters, changes, on_bodies, on_planes, raster
from tests.run.command import ROOT, inside

KERNELS = {
    f"{module.__name__}.{name}": kernel
    for module in (*(edges, masks, surfaces), *(casters, changes, on_bodies, on_planes, raster))
    for name, kernel in vars(module).items()
    if hasattr(kernel, "signatures")
}
PRINT = """
from pipeline.run.compile_ahead import compile_drawing
from tests.run.test_compile_ahead import KERNELS
compile_drawing()
for name, kernel in KERNELS.items():
    print(name, *kernel.signatures, sep="|")
"""


def test_the_kernels_compiled_ahead_are_those_that_an_episode_calls(tmp_path):
    wanted = "--tasks", "click_bell", "--levels", "0", "--episodes", "1", "--size", "64x48"
    code, _, err = inside("build", *wanted, "--executor", "inline", "--quiet", "--out", tmp_path)
    assert code == 0, err
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    out = subprocess.check_output([sys.executable, "-c", PRINT], env=environment, text=True)
    ahead = {name: types for name, *types in (line.split("|") for line in out.splitlines())}
    assert ahead.keys() == KERNELS.keys()
    for name, kernel in KERNELS.items():
        called = {str(types) for types in kernel.signatures}
        # a kernel that only others call has no signature where those come from the cache
        assert set(ahead[name]) <= called, name
    assert all(ahead[f"{edges.__name__}.{name}"] for name in ("_blend", "through_lens"))
    assert all(ahead[f"{masks.__name__}.{name}"] for name in ("_above", "_mix"))
    assert all(ahead[f"{surfaces.__name__}.{name}"] for name in ("_fill", "_open"))
    assert ahead[f"{on_bodies.__name__}.shade_bodies"] and ahead[f"{casters.__name__}.fill_depths"]


def test_a_process_compiles_only_what_the_cache_lacks_and_ends_with_the_build(monkeypatch):
    started = []
    popen = subprocess.Popen
    monkeypatch.setattr(compile_ahead, "usable_cores", lambda: 2)
    monkeypatch.setattr(
        compile_ahead, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1]
    )
    compile_ahead.compile_drawing()
    assert is_compiled()
    with compiling_ahead():
        assert not started
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda: False)
    begun = time.monotonic()
    with compiling_ahead():
        assert started[0].poll() is None
    assert started[0].returncode is not None and time.monotonic() - begun < 5
