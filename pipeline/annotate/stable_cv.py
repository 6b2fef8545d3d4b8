"""The same OpenCV results on every x86-64 machine.

OpenCV picks SIMD kernels by CPU at run time; its AVX2 kernels use fused multiply-add, so Farneback differs in the last bits
(7e-6 px measured) between machines. With `cv2.setUseOptimized(False)` only the compiled-in baseline (SSE3) runs, IPP and OpenCL
are off, and at 64x64 the calls we make are no slower. Threads change nothing here, but one per process is set anyway, because
workers share the machine.

Guaranteed: the same opencv-python-headless release on any x86-64 CPU gives the same bytes (tests force other CPU features).
Not guaranteed: another OpenCV release, or another architecture (aarch64 wheels are compiled with other baselines).
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2


@dataclass
class _Depth:
    """How many callers want stable results now; OpenCV's switch is one per process, so the count must be too."""

    count: int = 0
    before: tuple[bool, int] = (True, 1)
    lock: threading.Lock = field(default_factory=threading.Lock)


_DEPTH = _Depth()


@contextmanager
def bit_stable() -> Iterator[None]:
    """While any thread is inside, OpenCV uses its baseline kernels and one thread; the last one out restores what was set."""
    with _DEPTH.lock:
        if _DEPTH.count == 0:
            _DEPTH.before = (cv2.useOptimized(), cv2.getNumThreads())
            cv2.setUseOptimized(False)
            cv2.setNumThreads(1)
        _DEPTH.count += 1
    try:
        yield
    finally:
        with _DEPTH.lock:
            _DEPTH.count -= 1
            if _DEPTH.count == 0:
                cv2.setUseOptimized(_DEPTH.before[0])
                cv2.setNumThreads(_DEPTH.before[1])
