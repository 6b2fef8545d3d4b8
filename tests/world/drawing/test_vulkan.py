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
    with pytest.raises(vulkan.NoRenderer, match="lavapipe >= 25"):
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


def test_a_limit_of_file_sizes_that_would_end_the_process_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(vulkan.resource, "getrlimit", lambda _: (100 * 1024, 100 * 1024))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(vulkan._lavapipe_icd()))
    with pytest.raises(vulkan.NoRenderer, match="ulimit -f"):
        vulkan.ensure_renderer.__wrapped__()


def test_a_chosen_driver_that_does_not_work_is_one_line_not_a_crash(tmp_path: Path) -> None:
    (tmp_path / "none.json").write_text("{}")
    code = (
        "from pipeline.world.drawing.vulkan import *\ntry: ensure_renderer()\nexcept NoRenderer as"
        " e: print('line:', e)"
    )
    environment = {**os.environ, "VK_ICD_FILENAMES": str(tmp_path / "none.json")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
    )
    assert any(
        line.startswith("line: no Vulkan device") and "lavapipe" in line
        for line in done.stdout.splitlines()
    )
