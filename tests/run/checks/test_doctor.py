"""What doctor reports of machines that lack something."""

from collections import namedtuple

import pytest

from pipeline.run.checks import doctor
from pipeline.run.checks.doctor import attempt, judge_frame, judge_ray, judge_vulkan

DRAWN = {"device": "NVIDIA L4", "seconds": 0.5, "spread": 40.0}
Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import sys; sys.exit('no Vulkan device')", "exit code 1: no Vulkan device"),
        ("import os; os.abort()", "exit code -6"),
        ("print('hello')", "nothing that can be read"),
        ("", "nothing that can be read"),
    ],
)
def test_a_program_that_fails_is_one_line(code, said):
    assert said in str(attempt(code))


def test_a_program_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(doctor, "PATIENCE", 0.3)
    assert attempt("import time; time.sleep(60)") == "no answer within 0.3 s"


def test_frames_and_devices():
    assert judge_frame("exit code 1: it broke").verdict == "FAIL"
    assert judge_frame(DRAWN).verdict == "PASS"
    assert judge_frame(DRAWN | {"spread": 0.0}).verdict == "FAIL"
    vulkan = judge_vulkan("exit code 1: no Vulkan device", [])
    assert vulkan.verdict == "WARN" and "no Vulkan device" in vulkan.detail
    named = judge_vulkan({"why": "VK_ICD_FILENAMES names no file", "fix": "correct it"}, [])
    assert (named.verdict, named.fix) == ("WARN", "correct it")
    software = {"device": "llvmpipe (LLVM 15)"}
    assert judge_vulkan(software, ["/dev/nvidia0"]).verdict == "WARN"
    assert judge_vulkan(software, []).verdict == "PASS"
    assert judge_vulkan(DRAWN, ["/dev/nvidia0"]).verdict == "PASS"


def test_gpus_are_device_files(tmp_path):
    (tmp_path / "dri").mkdir()
    for name in ("nvidia0", "nvidiactl", "dri/renderD128", "dri/card0"):
        (tmp_path / name).touch()
    assert doctor.gpus(tmp_path) == [str(tmp_path / "dri/renderD128"), str(tmp_path / "nvidia0")]


def test_ray():
    assert judge_ray("no answer within 150 s").verdict == "WARN"
    assert judge_ray({"answer": 41, "seconds": 1}).verdict == "WARN"
    assert judge_ray({"answer": 42, "seconds": 1.0}).verdict == "PASS"


def test_this_machine_draws():
    assert judge_frame(attempt(doctor.FRAME)).verdict == "PASS"
    assert judge_vulkan(attempt(doctor.VULKAN), []).verdict == "PASS"


def test_a_driver_that_is_not_there_has_its_own_fix(monkeypatch):
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent/lvp.json")
    found = judge_vulkan(attempt(doctor.VULKAN), [])
    assert found.verdict == "WARN" and "/nonexistent/lvp.json" in found.detail
    assert "pipeline." not in found.detail and "unset" in found.fix and "Mesa" not in found.fix


@pytest.mark.parametrize(("free", "verdict"), [(0.5e9, "FAIL"), (5e9, "WARN"), (50e9, "PASS")])
def test_disk_where_the_dataset_is_to_be(tmp_path, monkeypatch, free, verdict):
    asked = []
    monkeypatch.setattr(
        doctor.shutil, "disk_usage", lambda path: asked.append(path) or Usage(1e12, 0, free)
    )
    found = doctor.check_disk(tmp_path / "not" / "there" / "yet")
    assert found.verdict == verdict and asked == [tmp_path]
    assert f"{free / 1e9:.1f} GB" in found.detail


def test_memory_is_that_of_the_control_group_where_it_is_limited(tmp_path):
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 16000000 kB\nMemAvailable: 4000000 kB\n")
    assert doctor.available_memory(meminfo, tmp_path) == 4e6 * 1024
    (tmp_path / "memory.current").write_text("300000000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert doctor.available_memory(meminfo, tmp_path) == 4e6 * 1024
    (tmp_path / "memory.max").write_text("1000000000\n")
    assert doctor.available_memory(meminfo, tmp_path) == 7e8


@pytest.mark.parametrize(
    ("available", "verdict", "fix"),
    [(0.1e9, "FAIL", "0.6"), (2e9, "WARN", "build with --workers 3"), (9e9, "PASS", "")],
)
def test_memory_for_workers(available, verdict, fix):
    found = doctor.check_memory(available, 8)
    assert found.verdict == verdict and fix in found.fix


@pytest.mark.parametrize(
    "owners", [["opencv-python", "opencv-python-headless"], ["opencv-python"], []]
)
def test_cv2_has_one_owner(owners):
    found = doctor.check_cv2(owners)
    assert found.verdict == "FAIL" and "--reinstall opencv-python-headless" in found.fix
    assert doctor.check_cv2(["opencv-python-headless"]).verdict == "PASS"
