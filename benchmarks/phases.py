"""Seconds of a slot by phase: the functions of every phase are timed where they are called."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any
from unittest.mock import patch

from pipeline.run.slot import make, redraw
from pipeline.stages import attempt, replay

TIMED = (
    *(("scene", attempt, "build_scene"), ("dry_run", attempt, "dry_run")),
    *(("back_calculate", attempt, "back_calculate"), ("replay", replay, "replay")),
    *(("replay", replay, "react"), ("read", redraw, "stored_appearance")),
    *(("render", make, "appearance_of"), ("render", make, "capture")),
    *(("tracks", make, "track_arrays"), ("encode", make, "encode_frames")),
    *(("write", make, "keep"), ("write", make, "write_episode"), ("write", make, "file_hash")),
)
"""Phase, module and function."""


@contextmanager
def timed_phases() -> Iterator[dict[str, float]]:
    """Wall seconds by phase, and processor seconds by phase + ".cpu", of what is called within."""
    seconds = defaultdict[str, float](float)

    def timed(phase: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def run(*given: Any, **named: Any) -> Any:
            began, worked = time.perf_counter(), time.process_time()
            try:
                return function(*given, **named)
            finally:
                seconds[phase] += time.perf_counter() - began
                seconds[f"{phase}.cpu"] += time.process_time() - worked

        return run

    with ExitStack() as patched:
        for phase, module, name in TIMED:
            function = timed(phase, getattr(module, name))
            patched.enter_context(patch.object(module, name, function))
        yield seconds
