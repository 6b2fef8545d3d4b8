"""What doctor says where drawing or Ray does not work."""

import pytest

from pipeline.run.doctor import alive
from pipeline.run.doctor.alive import attempt, judge_frame, judge_ray

DRAWN = {"device": "NVIDIA L4", "seconds": 0.5, "shape": [120, 160, 3], "spread": 40.0}
DEBIAN = {"ID": "debian", "VERSION_CODENAME": "bookworm"}


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
    assert said in attempt(code)


def test_a_program_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(alive, "PATIENCE", 0.3)
    assert attempt("import time; time.sleep(60)") == "no answer within 0.3 s"


def test_what_a_program_prints_last_is_its_answer():
    assert attempt('print("noise"); print(\'{"answer": 42}\')') == {"answer": 42}


def test_no_vulkan_device():
    vulkan, frame = judge_frame("exit code 1: no Vulkan device", [], DEBIAN)
    assert (vulkan.verdict, frame.verdict) == ("FAIL", "FAIL")
    assert "no Vulkan device" in vulkan.detail and "bookworm-backports" in vulkan.fix


def test_a_gpu_that_is_not_used():
    software = DRAWN | {"device": "llvmpipe (LLVM 15)"}
    assert [r.verdict for r in judge_frame(software, ["/dev/nvidia0"], DEBIAN)] == ["WARN", "PASS"]
    assert [r.verdict for r in judge_frame(software, [], DEBIAN)] == ["PASS", "PASS"]
    assert [r.verdict for r in judge_frame(DRAWN, ["/dev/nvidia0"], DEBIAN)] == ["PASS", "PASS"]


def test_a_frame_of_one_color():
    _, frame = judge_frame(DRAWN | {"spread": 0.0}, [], DEBIAN)
    assert frame.verdict == "FAIL" and "one color" in frame.detail


def test_gpus_are_device_files(tmp_path):
    assert alive.gpus(tmp_path) == []
    (tmp_path / "dri").mkdir()
    for name in ("nvidia0", "nvidiactl", "dri/renderD128", "dri/card0"):
        (tmp_path / name).touch()
    assert alive.gpus(tmp_path) == [str(tmp_path / "dri/renderD128"), str(tmp_path / "nvidia0")]


@pytest.mark.parametrize(
    ("answer", "verdict"),
    [("no answer within 150 s", "WARN"), ({"answer": 41, "seconds": 1}, "WARN")],
)
def test_ray_that_does_not_start(answer, verdict):
    found = judge_ray(answer)
    assert found.verdict == verdict and found.fix == "build with --executor inline"
    assert judge_ray({"answer": 42, "seconds": 1.0}).verdict == "PASS"


def test_a_frame_is_drawn_on_this_machine():
    answer = attempt(alive.FRAME)
    assert isinstance(answer, dict), answer
    assert answer["shape"] == [120, 160, 3] and answer["spread"] > 5
