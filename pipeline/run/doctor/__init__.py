"""`domino-data doctor`: whether this machine has what a build, an export and an annotation need."""

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from pipeline.data.process.machine import usable_cores
from pipeline.run.doctor import alive, machine, packages
from pipeline.run.doctor.machine import CheckResult


def diagnose(place: Path) -> Iterator[CheckResult]:
    """Examine this machine for datasets at `place`, in about 15 s; nothing is written or
    downloaded."""
    yield machine.check_python()
    yield from alive.judge_frame(alive.attempt(alive.FRAME), alive.gpus(), machine.os_release())
    yield packages.check_cv2()
    if packages.is_installed("ray"):
        yield alive.judge_ray(alive.attempt(alive.RAY))
    yield machine.check_disk(place)
    yield machine.check_memory(machine.available_memory(), usable_cores())
    yield machine.check_shared_memory()
    yield packages.check_video()
    yield packages.check_torchcodec(needed=packages.is_installed("torchcodec"))
    missing = packages.missing_by_extra(
        metadata.requires("domino-data") or (), packages.is_installed
    )
    yield from packages.check_extras(missing)
    if not missing.get("annotate", True):
        yield from packages.check_weights()
