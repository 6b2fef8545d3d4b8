"""Checks of packages: the owner of cv2, extras, reading and writing of video, weights."""

import io
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from importlib import metadata

from pipeline.annotate.networks.models import ALIASES, resolve
from pipeline.annotate.options import FeatureOptions, MaskOptions
from pipeline.annotate.stage_key import AnnotateError
from pipeline.run.doctor.machine import CheckResult

CV2 = "opencv-python-headless"
EXTRAS = {
    "ray": "several workers",
    "hub": "publishing on the hub",
    "lerobot": "reading exports with LeRobot",
    "annotate": "masks and features by model",
    "train": "training the example policy",
    "gr00t": "evaluating policies behind a GR00T server",
}
"""What each extra is for."""


def check_cv2(owners: Mapping[str, Sequence[str]] | None = None) -> CheckResult:
    """One package owns the module cv2: two overwrite each other's files."""
    found = sorted(
        set((metadata.packages_distributions() if owners is None else owners).get("cv2", ()))
    )
    fix = f"uv pip uninstall {' '.join(found or [CV2])}; uv pip install --reinstall {CV2}"
    both = [CV2.removesuffix("-headless"), CV2]
    if found not in ([CV2], both) or len({installed_version(name) for name in found}) > 1:
        return CheckResult(
            "cv2",
            "FAIL",
            f"cv2 belongs to {', '.join(found) or 'no package'}, and must to {CV2} alone",
            fix,
        )
    try:
        import cv2
    except ImportError as error:
        return CheckResult("cv2", "FAIL", f"cv2 does not load ({_line(error)})", fix)
    if found == both:
        return CheckResult("cv2", "WARN", "cv2 belongs to two packages of one version", fix)
    return CheckResult("cv2", "PASS", f"cv2 {cv2.__version__} belongs to {CV2}")


def missing_by_extra(
    requirements: Iterable[str], installed: Callable[[str], bool]
) -> dict[str, list[str]]:
    """Packages that are not installed, by extra that the requirements name."""
    missing: dict[str, list[str]] = {}
    for requirement in requirements:
        extra = re.search(r"extra == ['\"]([\w.-]+)['\"]", requirement)
        name = re.match(r"[\w.-]+", requirement)
        if extra and name and extra[1] in EXTRAS:
            missing.setdefault(extra[1], []).extend([] if installed(name[0]) else [name[0]])
    return missing


def installed_version(distribution: str) -> str:
    """The version of a package, "" for one that is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def is_installed(name: str) -> bool:
    """Whether a package is there."""
    return bool(installed_version(name))


def check_extras(missing: Mapping[str, Sequence[str]]) -> list[CheckResult]:
    """One result for each extra."""
    found = []
    for extra, packages in sorted(missing.items()):
        if packages:
            said = f"{', '.join(packages)} not installed: no {EXTRAS[extra]}"
            found.append(
                CheckResult(
                    f"extra {extra}",
                    "WARN",
                    said,
                    f"`make setup`, or uv pip install 'domino-data[{extra}]'",
                )
            )
        else:
            found.append(CheckResult(f"extra {extra}", "PASS", EXTRAS[extra]))
    return found


def check_video(attempt: Callable[[int], int] | None = None) -> CheckResult:
    """A video is written with the encoder of the default export, and read: `attempt` counts the
    frames."""
    wanted, fix = 2, "uv pip install --reinstall av"
    try:
        count = (attempt or _through_a_video)(wanted)
        version = metadata.version("av")
    except (ImportError, OSError, ValueError) as error:
        return CheckResult("video", "FAIL", f"no H.264 video can be written ({_line(error)})", fix)
    if count != wanted:
        return CheckResult(
            "video", "FAIL", f"{count} of {wanted} frames of a video are read again", fix
        )
    return CheckResult(
        "video", "PASS", f"PyAV {version} with its own FFmpeg writes and reads H.264"
    )


def _through_a_video(count: int) -> int:
    """Encode black frames; how many are decoded. Raises ImportError, OSError or ValueError."""
    import av

    data = io.BytesIO()
    with av.open(data, "w", "mp4") as container:
        stream = container.add_stream("h264", rate=Fraction(24))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(count):
            container.mux(stream.encode(av.VideoFrame(64, 48, "rgb24")))
        container.mux(stream.encode())
    data.seek(0)
    read = 0
    with av.open(data, "r") as container:
        read = sum(1 for _ in container.decode(video=0))
    return read


def check_torchcodec(
    command: Sequence[str] = (sys.executable, "-P", "-c", "import torchcodec"), needed: bool = True
) -> CheckResult:
    """Whether LeRobot's decoder finds FFmpeg's libraries; asked in a process of its own."""
    fix = "apt install ffmpeg, or LeRobotDataset(..., video_backend='pyav')"
    if not needed:
        return CheckResult("torchcodec", "PASS", "not installed; LeRobot reads videos with PyAV")
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    if done.returncode:
        why = "finds no FFmpeg" if "FFmpeg" in done.stderr else "does not load"
        return CheckResult("torchcodec", "WARN", f"LeRobot's reader of videos {why}", fix)
    return CheckResult("torchcodec", "PASS", "finds FFmpeg")


def check_weights(names: Sequence[str] | None = None) -> list[CheckResult]:
    """Whether the networks of `annotate` are on this machine."""
    wanted = names or (MaskOptions().detector, MaskOptions().segmenter, FeatureOptions().encoder)
    found = []
    for name in wanted:
        try:
            files = resolve(name, download=False)
        except AnnotateError as error:
            fix = f"hf download {ALIASES.get(name, name)}; --mask-source sim needs no weights"
            found.append(CheckResult(f"weights {name}", "WARN", _line(error), fix))
        else:
            found.append(CheckResult(f"weights {name}", "PASS", files.path))
    return found


def _line(error: object) -> str:
    return " ".join(str(error).split())[:200]
