"""`domino-data doctor`: whether this machine has what is needed."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from pipeline.data.process.machine import usable_cores
from pipeline.run.provenance import installed_version
from pipeline.world.drawing.vulkan import DRIVER


@dataclass(frozen=True)
class CheckResult:
    """`verdict` FAIL: nothing can be built; WARN: an optional part does not work."""

    name: str
    verdict: Literal["PASS", "WARN", "FAIL"]
    detail: str
    fix: str = ""


GB = 1e9
WORKER_BYTES = 0.6 * GB  # resident memory of one worker (docs/cluster.md)
PATIENCE = 150  # seconds; the first frame on a CPU takes about three, Ray about four
CV2 = "opencv-python-headless"
FRAME = """
import json, time
import numpy as np
from pipeline.world.drawing.renderer import device_of
device = device_of("raster")
from pipeline.intake.catalogue.gallery import portrait
from pipeline.world.objects import FAMILIES
began = time.perf_counter()
ball = FAMILIES["ball"].draw(np.random.Generator(np.random.Philox(0)))
image = portrait(ball, size=(160, 120))
seconds = time.perf_counter() - began
print(json.dumps({"device": device, "seconds": seconds, "spread": float(image.std())}))
"""
VULKAN = """
import json
from pipeline.world.drawing.vulkan import NoRenderer, ensure_renderer
try:
    answer = {"device": ensure_renderer()}
except NoRenderer as error:
    answer = {"why": error.why, "fix": error.fix}
print(json.dumps(answer))
"""
RAY = """
import json, time
from pipeline.crew.contract import Crew
from pipeline.crew.ray_session import session
began = time.perf_counter()
with session(Crew("ray", 1)):
    import ray
    answer = ray.get(ray.remote(lambda: 6 * 7).remote(), timeout=100)
print(json.dumps({"answer": answer, "seconds": time.perf_counter() - began}))
"""


def diagnose(place: Path) -> Iterator[CheckResult]:
    """Examine this machine for datasets at `place` (about 15 s), writing nothing."""
    yield judge_frame(attempt(FRAME))
    yield judge_vulkan(attempt(VULKAN), gpus())
    yield check_cv2(metadata.packages_distributions().get("cv2", ()))
    if installed_version("ray"):
        yield judge_ray(attempt(RAY))
    yield check_disk(place)
    yield check_memory(available_memory(), usable_cores())


def attempt(code: str) -> dict[str, Any] | str:
    """The JSON on a program's last line, or why there is none."""
    command = [sys.executable, "-P", "-c", code]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if line.strip()]
            return f"exit code {done.returncode}: {' '.join(lines[-1:])[:300]}".removesuffix(": ")
        return dict(json.loads(done.stdout.splitlines()[-1]))
    except subprocess.TimeoutExpired:
        return f"no answer within {PATIENCE} s"
    except (IndexError, ValueError):
        return "it printed nothing that can be read"


def gpus(dev: Path = Path("/dev")) -> list[str]:
    """Device files of GPUs."""
    patterns = ("nvidia[0-9]*", "dri/renderD*", "dxg")
    return sorted(str(path) for pattern in patterns for path in dev.glob(pattern))


def judge_frame(answer: Mapping[str, Any] | str) -> CheckResult:
    """What drew a frame of the default preset."""
    if isinstance(answer, str):
        return CheckResult("frame", "FAIL", f"nothing can be drawn ({answer})", DRIVER)
    text = f"160x120 by {answer['device']} in {answer['seconds']:.1f} s, the first"
    if answer["spread"] < 1:
        fix = "try another driver: set VK_ICD_FILENAMES"
        return CheckResult("frame", "FAIL", f"{text}, and it is of one color", fix)
    return CheckResult("frame", "PASS", text)


def judge_vulkan(answer: Mapping[str, Any] | str, nodes: Sequence[str]) -> CheckResult:
    """The Vulkan device, which `--render rt` and older looks need."""
    if isinstance(answer, str):
        answer = {"why": answer, "fix": DRIVER}
    if "why" in answer:
        lost = f"--render rt and datasets of older looks cannot be drawn ({answer['why']})"
        return CheckResult("vulkan", "WARN", lost, answer["fix"])
    device = str(answer["device"])
    software = any(name in device.lower() for name in ("llvmpipe", "swiftshader"))
    if software and nodes:
        unused = f"{device} is used, although there is {nodes[0]}"
        return CheckResult("vulkan", "WARN", unused, DRIVER)
    return CheckResult("vulkan", "PASS", device)


def judge_ray(answer: Mapping[str, Any] | str) -> CheckResult:
    """Whether a worker of Ray answered."""
    if isinstance(answer, str) or answer["answer"] != 42:
        fix = "build with --executor inline"
        return CheckResult("ray", "WARN", f"does not start ({answer})", fix)
    return CheckResult("ray", "PASS", f"a worker answered after {answer['seconds']:.1f} s")


def check_disk(place: Path) -> CheckResult:
    """Room where datasets are to be written."""
    there = next(p for p in (place.absolute(), *place.absolute().parents) if p.exists())
    free = shutil.disk_usage(there).free
    text = f"{free / GB:.1f} GB free at {there}; an episode takes 1 to 5 MB"
    if free >= 10 * GB:
        return CheckResult("disk", "PASS", text)
    fix = "free some space, or give another place with --out"
    return CheckResult("disk", "FAIL" if free < GB else "WARN", text, fix)


def available_memory(
    meminfo: Path = Path("/proc/meminfo"), group: Path = Path("/sys/fs/cgroup")
) -> float:
    """Bytes new processes may use, within the control group."""
    fields = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
    free = float(fields["MemAvailable"].split()[0]) * 1024
    limit, used = group / "memory.max", group / "memory.current"
    if limit.is_file() and used.is_file() and (text := limit.read_text().strip()).isdigit():
        free = min(free, float(text) - float(used.read_text()))
    return max(free, 0.0)


def check_memory(available: float, cores: int) -> CheckResult:
    """Memory for one worker on every core."""
    workers = min(cores, int(available // WORKER_BYTES))
    text = f"{available / GB:.1f} GB available, enough for {workers} of {cores} workers"
    if workers == 0:
        return CheckResult("memory", "FAIL", text, f"free {WORKER_BYTES / GB:g} GB")
    if workers < cores:
        return CheckResult("memory", "WARN", text, f"build with --workers {workers}")
    return CheckResult("memory", "PASS", text)


def check_cv2(owners: Iterable[str]) -> CheckResult:
    """One package owns the module cv2: two overwrite each other's files."""
    found = sorted(set(owners))
    text = f"cv2 belongs to {', '.join(found) or 'no package'}"
    if found == [CV2]:
        return CheckResult("cv2", "PASS", text)
    fix = f"uv pip uninstall {' '.join(found or [CV2])}; uv pip install --reinstall {CV2}"
    both = [CV2.removesuffix("-headless"), CV2]
    same = found == both and len({installed_version(name) for name in both}) == 1
    return CheckResult("cv2", "WARN" if same else "FAIL", f"{text}, not to {CV2} alone", fix)
