"""Compiles the rasteriser's functions."""

from hashlib import sha256
from pathlib import Path
from types import CellType, FunctionType
from typing import Any

from numba import njit

SOURCES = sha256(
    b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))
).hexdigest()


def kernel(function: Any, sources: str = SOURCES) -> Any:
    """The function, compiled; it meets no NaN. Sums keep their order and products are not fused, so
    that the same image has the same bytes however and wherever it was compiled.

    Numba compiles again if the kernel's own file changed, not if that of a kernel which it calls
    did. What a closure holds is part of its cache's key, so each kernel holds all files' hash.
    """
    code = function.__code__.replace(co_freevars=("sources",))
    names = function.__globals__
    held = FunctionType(code, names, closure=(CellType(sources),))
    return njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})(held)
