"""Flow: the original's image, the frame pairs, the scales, and the same bytes under other CPU
features."""

import itertools
import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.annotate.flow import (
    Colour,
    Farneback,
    bit_stable,
    colour_flow,
    farneback,
    flow_of,
    previous_frames,
    shrink_grey,
)


def texture(
    height: int, width: int, dx: float = 0.0, dy: float = 0.0, seed: int = 0
) -> NDArray[np.uint8]:
    """A smooth coloured image moved by (dx, dy) px: a sum of waves, so that any shift is exact."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width].astype(float)
    out = np.zeros((height, width, 3))
    for _ in range(8):
        fx, fy = rng.uniform(-0.35, 0.35, 2)
        out += np.sin(fx * (x - dx) + fy * (y - dy))[..., None] * rng.uniform(0.3, 1, 3)
    return np.round(127.5 + 127.5 * out / np.abs(out).max()).astype(np.uint8)


def original_map(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The paper's pipeline spelled out with plain calls (per-map 99th percentile, baseline
    kernels)."""
    grey = [
        cv2.cvtColor(cv2.resize(f, (64, 64), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        for f in (before, after)
    ]
    flow = cv2.calcOpticalFlowFarneback(grey[0], grey[1], None, 0.5, 3, 15, 3, 5, 1.2, 0)
    magnitude, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
    p99 = np.percentile(magnitude, 99)
    value = np.zeros_like(magnitude) if p99 < 1e-6 else np.clip(magnitude / p99 * 255, 0, 255)
    hsv = np.stack([np.mod(angle / 2, 180), np.full_like(angle, 255), value], -1).astype(np.uint8)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


@pytest.mark.parametrize("size", [(240, 320), (480, 640), (64, 64)])
def test_default_map_is_the_papers(size: tuple[int, int]):
    frames = [texture(*size, dx=d, dy=-d / 2) for d in (0, 3, 7)]
    grey = np.stack([shrink_grey(f, (64, 64)) for f in frames])
    rgb, scale = colour_flow(flow_of(grey, 1, Farneback()), Colour())
    assert (rgb[0] == 0).all() and scale[0] == 0
    with bit_stable():
        for t in (1, 2):
            expected = original_map(frames[t - 1], frames[t])
            different = np.abs(rgb[t].astype(int) - expected)
            assert different.max() <= 1 and (different > 0).mean() < 1e-3


def test_farneback_measures_a_known_shift():
    before, after = (shrink_grey(texture(480, 640, dx=d), (64, 64)) for d in (0, 6))
    flow = farneback(before, after, Farneback())[8:-8, 8:-8]
    assert abs(flow[..., 0].mean() - 0.6) < 0.03
    assert abs(flow[..., 1].mean()) < 0.03


def test_pairs_are_absolute_clamped_and_computed_once(monkeypatch: pytest.MonkeyPatch):
    assert previous_frames(7, 4).tolist() == [0, 0, 0, 0, 0, 1, 2]
    grey = np.stack([shrink_grey(texture(64, 64, dx=d), (64, 64)) for d in range(7)])
    calls: list[tuple[int, int]] = []

    def counted(
        before: NDArray[np.uint8], after: NDArray[np.uint8], options: Farneback
    ) -> NDArray[np.float32]:
        calls.append(
            tuple(
                next(i for i, g in enumerate(grey) if g is f or (g == f).all())
                for f in (before, after)
            )
        )
        return farneback(before, after, options)

    monkeypatch.setattr("pipeline.annotate.flow.farneback", counted)
    flow = flow_of(grey, 4, Farneback())
    assert calls == [(0, 1), (0, 2), (0, 3), (0, 4), (1, 5), (2, 6)]
    # the four pairs that the original takes at step s, clamped frames s-16, s-12, ..., s, are rows
    # of the one array
    for s in range(7):
        steps = [max(0, s + o) for o in (-16, -12, -8, -4, 0)]
        for a, b in itertools.pairwise(steps):
            expected = np.zeros((64, 64, 2)) if a == b else farneback(grey[a], grey[b], Farneback())
            np.testing.assert_array_equal(flow[b], expected)


def test_normalisations_keep_or_lose_speed():
    flow = np.zeros((3, 64, 64, 2), np.float32)
    flow[1, ..., 0], flow[2, ..., 0] = 0.5, 1.0
    bright = {
        n: colour_flow(flow, Colour(n, full_scale=2.0)) for n in ("per_map", "shared", "fixed")
    }
    value = {n: rgb.max(-1)[:, 0, 0].tolist() for n, (rgb, _) in bright.items()}
    assert value == {"per_map": [0, 255, 255], "shared": [0, 127, 255], "fixed": [0, 63, 127]}
    assert bright["fixed"][1].tolist() == [0, 2, 2]
    assert bright["per_map"][1].tolist() == [0, 0.5, 1]
    assert bright["shared"][1].tolist() == [1, 1, 1]


def test_hue_is_direction():
    flow = np.zeros((4, 16, 16, 2), np.float32)
    for i, (x, y) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
        flow[i] = x, y
    rgb, _ = colour_flow(flow, Colour())
    hue = [int(cv2.cvtColor(m, cv2.COLOR_RGB2HSV)[0, 0, 0]) for m in rgb]
    np.testing.assert_allclose(hue, [0, 45, 90, 135], atol=1)


def test_threshold_blackens_noise_maps_only():
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 0.01, (2, 64, 64, 2)).astype(np.float32)
    flow[1, 20:40, 20:40] += 1.5
    rgb, scale = colour_flow(flow, Colour(threshold=0.05))
    assert (rgb[0] == 0).all() and scale[0] == 0
    assert rgb[1].max() == 255
    magnitude = np.hypot(*np.moveaxis(flow[1], -1, 0))
    assert scale[1] == pytest.approx(np.percentile(magnitude, 99), rel=1e-6)


HASHES = """
import hashlib, json
import numpy as np
from pipeline.annotate.flow import Colour, Farneback, colour_flow, flow_of, shrink_grey
from tests.annotate.test_flow import texture
grey = np.stack([shrink_grey(texture(240, 320, dx=1.3 * t, dy=-0.7 * t), (64, 64)) for t in range(5)])
flow = flow_of(grey, 2, Farneback())
rgb, scale = colour_flow(flow, Colour())
print(json.dumps([hashlib.sha256(a.tobytes()).hexdigest() for a in (grey, flow, rgb, scale)]))
"""  # noqa: E501


def test_bytes_do_not_depend_on_cpu_features_ipp_threads_or_libm():
    baseline = {
        "OPENCV_CPU_DISABLE": "AVX2,AVX512-SKX,AVX",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    }
    variants = [
        {},
        baseline,
        {"OPENCV_IPP": "disabled", "OPENCV_FOR_THREADS_NUM": "2", "OMP_NUM_THREADS": "2"},
    ]

    def run(extra: dict[str, str]) -> list[str]:
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **extra}
        done = subprocess.run(
            [sys.executable, "-c", HASHES], env=env, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout.splitlines()[-1])

    with ThreadPoolExecutor(3) as pool:
        first, *others = pool.map(run, variants)
    assert others == [first, first]


def test_stable_switch_nests_and_restores():
    cv2.setUseOptimized(True)
    with bit_stable():
        with bit_stable():
            assert not cv2.useOptimized() and cv2.getNumThreads() == 1
        assert not cv2.useOptimized()
    assert cv2.useOptimized()


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_flow_of_every_thread_has_the_same_bytes(threads: int):
    """IPP's switch belongs to a thread: each must set its own."""
    still = texture(64, 64)[..., 0]
    # IPP's results differ in the last bits where something small moves before what is still
    grey = np.stack([cv2.circle(still.copy(), (20 + 2 * t, 30), 6, 200, -1) for t in range(8)])
    wanted = flow_of(grey, 1, Farneback())
    together = threading.Barrier(threads)

    def compute(_: int) -> list[bytes]:
        together.wait(30)
        return [flow_of(grey, 1, Farneback()).tobytes() for _ in range(5)]

    with ThreadPoolExecutor(threads) as pool:
        computed = [each for one in pool.map(compute, range(threads)) for each in one]
    here = flow_of(grey, 1, Farneback())
    np.testing.assert_array_equal(here, wanted)
    assert set(computed) == {wanted.tobytes()}
    assert cv2.ipp.useIPP() and cv2.useOptimized()
