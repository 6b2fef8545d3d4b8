"""What doctor says of machines that lack something."""

from collections import namedtuple

import pytest

from pipeline.run.doctor import machine

Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize(
    ("version", "processor", "verdict", "said"),
    [
        ((3, 12, 1), "x86_64", "PASS", "3.12.1"),
        ((3, 11, 9), "x86_64", "FAIL", "3.12 is needed"),
        ((3, 13, 0), "x86_64", "FAIL", "3.12 is needed"),
        ((3, 12, 1), "aarch64", "WARN", "aarch64"),
    ],
)
def test_python(version, processor, verdict, said):
    found = machine.check_python(version, processor)
    assert (found.verdict, bool(found.fix)) == (verdict, verdict != "PASS")
    assert said in found.detail


@pytest.mark.parametrize(("free", "verdict"), [(0.5e9, "FAIL"), (5e9, "WARN"), (50e9, "PASS")])
def test_disk_where_the_dataset_is_to_be(tmp_path, monkeypatch, free, verdict):
    asked = []
    monkeypatch.setattr(
        machine.shutil, "disk_usage", lambda path: asked.append(path) or Usage(1e12, 0, free)
    )
    found = machine.check_disk(tmp_path / "not" / "there" / "yet")
    assert found.verdict == verdict and asked == [tmp_path]
    assert f"{free / 1e9:.1f} GB" in found.detail


def test_memory_is_that_of_the_control_group_where_it_is_limited(tmp_path):
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 16000000 kB\nMemAvailable: 4000000 kB\n")
    assert machine.available_memory(meminfo, tmp_path) == 4e6 * 1024
    (tmp_path / "memory.current").write_text("300000000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert machine.available_memory(meminfo, tmp_path) == 4e6 * 1024
    (tmp_path / "memory.max").write_text("1000000000\n")
    assert machine.available_memory(meminfo, tmp_path) == 7e8


@pytest.mark.parametrize(
    ("available", "verdict", "said"),
    [(0.1e9, "FAIL", "0.6"), (2e9, "WARN", "3 of 8"), (9e9, "PASS", "8 of 8")],
)
def test_memory_for_workers(available, verdict, said):
    found = machine.check_memory(available, 8)
    assert found.verdict == verdict and said in found.detail
    assert verdict != "WARN" or found.fix == "build with --workers 3"


def test_little_shared_memory_or_none(tmp_path, monkeypatch):
    assert machine.check_shared_memory(tmp_path / "none").verdict == "WARN"
    monkeypatch.setattr(machine.shutil, "disk_usage", lambda path: Usage(64e6, 0, 64e6))
    found = machine.check_shared_memory(tmp_path)
    assert found.verdict == "WARN" and "64 MB" in found.detail and "--shm-size" in found.fix


@pytest.mark.parametrize(
    ("text", "gpu", "said"),
    [
        (
            "ID=debian\nVERSION_CODENAME=bookworm\n",
            False,
            "apt install -t bookworm-backports mesa-vulkan-drivers",
        ),
        ("ID=ubuntu\nID_LIKE=debian\n", False, "ppa:kisak"),
        ('ID=pop\nID_LIKE="ubuntu debian"\n', False, "ppa:kisak"),
        ('ID="rhel"\nID_LIKE="fedora"\n', False, "dnf install"),
        ("ID=arch\n", False, "pacman"),
        ("", False, "mesa-vulkan-drivers"),
        ("ID=debian\n", True, "NVIDIA_DRIVER_CAPABILITIES"),
    ],
)
def test_how_a_driver_is_installed_here(tmp_path, text, gpu, said):
    (tmp_path / "os-release").write_text(text)
    assert said in machine.driver_advice(machine.os_release(tmp_path / "os-release"), gpu)
    assert machine.os_release(tmp_path / "none") == {}
