"""What doctor says of packages that are missing, doubled or broken."""

import sys

import pytest

from pipeline.run.doctor import packages


@pytest.mark.parametrize(
    ("owners", "said"),
    [
        (
            {"cv2": ["opencv-python", "opencv-python-headless"]},
            "opencv-python, opencv-python-headless",
        ),
        ({"cv2": ["opencv-python"]}, "belongs to opencv-python,"),
        ({}, "no package"),
    ],
)
def test_cv2_has_one_owner(owners, said):
    found = packages.check_cv2(owners)
    assert found.verdict == "FAIL" and said in found.detail
    assert "--reinstall opencv-python-headless" in found.fix


def test_cv2_of_this_environment():
    assert packages.check_cv2().verdict == "PASS"


def test_extras_name_what_they_lack():
    wanted = [
        "torch<3; extra == 'annotate'",
        'transformers>=5 ; extra == "annotate"',
        "pyarrow; extra == 'lerobot'",
        "numpy>=2",
        "x; extra == 'other'",
    ]
    missing = packages.missing_by_extra(wanted, lambda name: name != "transformers")
    assert missing == {"annotate": ["transformers"], "lerobot": []}
    annotate, lerobot = packages.check_extras(missing)
    assert (annotate.verdict, lerobot.verdict) == ("WARN", "PASS")
    assert "transformers" in annotate.detail and "domino-data[annotate]" in annotate.fix


def test_a_package_that_nobody_has_is_not_installed():
    assert packages.is_installed("numpy") and not packages.is_installed("domino-no-such-package")


def test_video():
    assert packages.check_video().verdict == "PASS"

    def refused(count):
        raise OSError("Encoder not found")

    assert "Encoder not found" in packages.check_video(refused).detail
    assert packages.check_video(refused).verdict == "FAIL"
    assert packages.check_video(lambda count: count - 1).verdict == "FAIL"


@pytest.mark.parametrize(
    ("code", "verdict", "said"),
    [
        (
            "raise OSError('Could not load libtorchcodec: FFmpeg is not properly installed')",
            "WARN",
            "finds no FFmpeg",
        ),
        ("import domino_no_such_module", "WARN", "does not load"),
        ("", "PASS", "finds FFmpeg"),
    ],
)
def test_torchcodec_without_ffmpeg_is_one_line(code, verdict, said):
    found = packages.check_torchcodec((sys.executable, "-S", "-c", code))
    assert (found.verdict, found.detail.count("\n")) == (verdict, 0)
    assert said in found.detail
    assert verdict == "PASS" or "apt install ffmpeg" in found.fix


def test_weights_that_are_here_and_that_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "empty"))
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "config.json").write_text("{}")
    (tmp_path / "here" / "model.safetensors").write_bytes(b"")
    here, gone = packages.check_weights((str(tmp_path / "here"), str(tmp_path / "gone")))
    assert (here.verdict, here.detail) == ("PASS", str(tmp_path / "here"))
    assert gone.verdict == "WARN" and str(tmp_path / "gone") in gone.detail
