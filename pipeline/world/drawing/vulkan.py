"""Choose a Vulkan driver before SAPIEN renders: a working GPU, else Mesa lavapipe on the CPU."""

import os
import platform
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from pipeline.data.errors import DominoError

ICD_FOLDERS = (
    Path("/usr/share/vulkan/icd.d"),
    Path("/usr/local/share/vulkan/icd.d"),
    Path("/etc/vulkan/icd.d"),
)
DRIVER = (
    "install Mesa >= 25: apt install mesa-vulkan-drivers libvulkan1 (Debian 12: -t"
    " bookworm-backports; old Ubuntu: ppa:kisak/kisak-mesa), dnf install mesa-vulkan-drivers"
    " vulkan-loader, or pacman -S vulkan-swrast vulkan-icd-loader; or the GPU's own driver (in a"
    " container: NVIDIA_DRIVER_CAPABILITIES=all)"
)
"""How to get a Vulkan driver."""

_PROBE = "import sapien; print(sapien.render.get_device_summary())"


class NoRenderer(DominoError):
    """No Vulkan device that SAPIEN can draw with: `why`, and the `fix`."""

    def __init__(self, why: str, fix: str = DRIVER) -> None:
        super().__init__(why, fix)
        self.why, self.fix = why, fix

    def __str__(self) -> str:
        return f"{self.why}: {self.fix}"


@cache
def has_gpu() -> bool:
    """Whether the driver that `ensure_renderer` chooses draws on a GPU."""
    _, chosen, drivers = _chosen_drivers()
    return any(drivers) and "lvp" not in chosen if chosen else _gpu_works()


@cache
def ensure_renderer() -> str:
    """Choose a driver before `sapien.render` is used; returns the device's name.

    VK_ICD_FILENAMES or VK_DRIVER_FILES stay. Else, without a supported GPU, VK_ICD_FILENAMES
    becomes lavapipe. LP_NUM_THREADS becomes 0 unless it is 2 or more: one worker per core scales
    better than threads. Raises NoRenderer.
    """
    name, chosen, drivers = _chosen_drivers()
    if drivers and not any(drivers):
        raise NoRenderer(
            f"{name} names no file that is there ({chosen})",
            "correct it, or unset it to use the installed drivers",
        )
    if not chosen and not _gpu_works():
        icd = _lavapipe_icd()
        if icd is None:
            raise NoRenderer("no Vulkan device, which rt and older looks need")
        os.environ["VK_ICD_FILENAMES"] = str(icd)
    # 1 means a thread beside the one that submits, which waits for it: without it a frame takes a
    # tenth less of a core.
    if os.environ.get("LP_NUM_THREADS", "1") == "1":
        os.environ["LP_NUM_THREADS"] = "0"
    import sapien  # after the environment is settled: the driver is chosen at the first use

    try:
        return sapien.render.RenderSystem().device.name
    except RuntimeError as error:
        raise NoRenderer(f"no Vulkan device can be used ({error})") from error


def _chosen_drivers() -> tuple[str, str, list[bool]]:
    """The variable that names drivers, its value, and of each driver whether it is there."""
    name = "VK_ICD_FILENAMES" if os.environ.get("VK_ICD_FILENAMES") else "VK_DRIVER_FILES"
    chosen = os.environ.get(name, "")
    return name, chosen, [Path(part).exists() for part in chosen.split(os.pathsep) if part]


def _lavapipe_icd() -> Path | None:
    drivers = sorted(path for folder in ICD_FOLDERS for path in folder.glob("lvp_icd*.json"))
    return min(drivers, key=lambda path: platform.machine() not in path.name, default=None)


def _gpu_works() -> bool:
    """Whether SAPIEN lists a supported GPU; a subprocess contains crashes."""
    if not any(any(Path("/dev").glob(node)) for node in ("nvidia[0-9]*", "dri/renderD*", "dxg")):
        return False
    try:
        probe = subprocess.run(
            [sys.executable, "-P", "-c", _PROBE],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
    except (subprocess.SubprocessError, OSError):
        return False
    return hardware_device(probe.stdout)


def hardware_device(summary: str) -> bool:
    """Whether the summary lists a supported device that is no software rasteriser."""
    devices = (block.partition("\n") for block in summary.split("GPU:")[1:])
    return any(
        "Supported: 1" in rest and not re.search("llvmpipe|swiftshader", name, re.IGNORECASE)
        for name, _, rest in devices
    )
