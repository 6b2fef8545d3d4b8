"""Choosing a Vulkan driver: software is told from hardware, and a machine without either gets one
clear line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.world.drawing import vulkan

SOFTWARE = "GPU: llvmpipe (LLVM 15.0.6, 256 bits)\n  Supported: 1\n"


def test_device_summary_tells_hardware_from_software() -> None:
    assert not vulkan.hardware_device("") and not vulkan.hardware_device(SOFTWARE)
    assert not vulkan.hardware_device("GPU: NVIDIA H100\n  Supported: 0\n" + SOFTWARE)
    assert vulkan.hardware_device(SOFTWARE + "GPU: NVIDIA GeForce RTX 4090\n  Supported: 1\n")


def test_no_gpu_and_no_lavapipe_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VK_ICD_FILENAMES", raising=False)
    monkeypatch.delenv("VK_DRIVER_FILES", raising=False)
    monkeypatch.setattr(vulkan, "ICD_FOLDERS", ())
    monkeypatch.setattr(vulkan, "_gpu_works", lambda: False)
    with pytest.raises(vulkan.NoRenderer, match="Mesa >= 25"):
        vulkan.ensure_renderer.__wrapped__()


def test_driver_of_this_architecture_is_preferred(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(vulkan, "ICD_FOLDERS", (tmp_path,))
    monkeypatch.setattr(vulkan.platform, "machine", lambda: "x86_64")
    for name in (
        "lvp_icd.aarch64.json",
        "lvp_icd.i686.json",
        "lvp_icd.x86_64.json",
        "radeon_icd.x86_64.json",
    ):
        (tmp_path / name).write_text("{}")
    assert vulkan._lavapipe_icd() == tmp_path / "lvp_icd.x86_64.json"


def test_a_chosen_driver_that_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VK_ICD_FILENAMES", f"{tmp_path}/none.json:{tmp_path}/neither.json")
    with pytest.raises(vulkan.NoRenderer, match=r"^VK_ICD_FILENAMES .*none\.json"):
        vulkan.ensure_renderer.__wrapped__()


DRAW = """
from pipeline.intake.catalogue.gallery import portrait
from pipeline.world.drawing.renderer import device_of
from pipeline.world.objects.families.toys.blocks import Block
print("drawn:", device_of("raster"), portrait(Block(0.05, 0.002, "painted", "blue")).std())
device_of("rt")
"""


def test_without_a_vulkan_device_only_rt_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "lvp.json").write_text("{}")  # a driver that does not work
    environment = {**os.environ, "VK_ICD_FILENAMES": str(tmp_path / "lvp.json")}
    done = subprocess.run(
        [sys.executable, "-c", DRAW], capture_output=True, text=True, env=environment, check=False
    )
    (drawn,) = (line for line in done.stdout.splitlines() if line.startswith("drawn:"))
    assert "domino-data's rasteriser" in drawn and float(drawn.split()[-1]) > 1
    refusal = done.stderr.splitlines()[-1]
    assert "NoRenderer: no Vulkan device can be used" in refusal and "Mesa >= 25" in refusal


def test_a_driver_that_is_not_there_is_no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent/nvidia.json")
    assert not vulkan.has_gpu.__wrapped__()
    monkeypatch.setenv("VK_ICD_FILENAMES", __file__)
    assert vulkan.has_gpu.__wrapped__()
