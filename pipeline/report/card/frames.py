"""The part of a card about frames: their cameras, how well they show the target, and how many of
them are idle."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.data.cameras import CameraType, intrinsics
from pipeline.data.names import exported_names
from pipeline.motion.recorded import LEAST, SECONDS, is_hidden, is_unoccluded
from pipeline.report.card.markdown import table
from pipeline.report.card.survey import SurveyedEpisode

IN_VIEW = 0.95
"""The card names a task whose target is in a camera's image in a smaller share of frames, or at the
end of fewer episodes."""

VISIBILITY = f"""\
How much of the target's silhouette is in the image and not behind the robot or another body.
An episode hides the target if less than {100 * LEAST:.0f} % is visible in all frames of the last
{SECONDS:g} s before the meeting. The recipe key `view: unoccluded` rejects attempts in which this
holds for more than half of these frames of the head camera:

"""


def visibility(seen: Sequence[SurveyedEpisode], names: Mapping[str, str]) -> str:
    """How much of the target the cameras see, by their exported `names`; "" if no episode states
    it."""
    rows = []
    for camera, name in names.items():
        tracked = [one for one in seen if camera in one.visible]
        if not tracked:
            continue
        shares = np.concatenate([one.visible[camera] for one in tracked])
        lasts = [one.last_visible[camera] for one in tracked]
        hidden = np.mean([is_hidden(last) for last in lasts])
        rejected = np.mean([not is_unoccluded(last) for last in lasts])
        values = (*np.quantile(shares, (0.1, 0.5, 0.9)), hidden, rejected)
        rows.append([name, *(f"{100 * value:.0f}" for value in values)])
    head = (
        "camera | visible share, 10th percentile of the frames (%) | median (%) |"
        " 90th percentile (%) | episodes that hide the target (%) |"
        " episodes that `view: unoccluded` rejects (%)"
    )
    return VISIBILITY + table(head, rows) if rows else ""


def idle(seen: Sequence[SurveyedEpisode]) -> str:
    """How many frames come after the success, and in how many nothing is commanded to move."""
    frames = sum(one.frames for one in seen)
    after = 100 * sum(one.after_success for one in seen) / frames
    still = 100 * sum(one.still for one in seen) / frames
    return (
        f"{after:.1f} % of the frames come after the success; the option `--after-success` of the"
        f" LeRobot export leaves them out. In {still:.1f} % no command changes by more than 1"
        " mrad.\n\n"
    )


def camera_names(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> Mapping[str, str]:
    """The cameras as the export calls them, by their names in an episode."""
    stored = seen[0].cameras
    names = {camera: camera for camera in stored}
    if summary["format"] not in ("robotwin", "dynamicwam", "puma-gt"):
        names = dict(exported_names(stored, summary["options"].get("camera_names", {})))
    return names | summary.get("cameras", {})


def cameras(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    """The table of cameras, by size, lens and what carries them."""
    names, robots = camera_names(seen, summary), defaultdict[tuple[str, ...], list[str]](list)
    for robot, one in sorted({one.spec.embodiment: one for one in reversed(seen)}.items()):
        for camera in one.cameras:
            info = one.meta.drawing.cameras[camera]
            focal = intrinsics(CameraType(info.width, info.height, info.fovy))[0, 0]
            size, link = f"{info.width} x {info.height}", info.link or "fixed in the world"
            robots[names.get(camera, camera), size, f"{info.fovy:g}", f"{focal:.1f}", link].append(
                robot
            )
    head = (
        "camera | pixels | vertical field of view (degrees) | focal length (pixels) | carried by |"
        " robots"
    )
    return table(
        head,
        [[*row, ", ".join(names_of_robots)] for row, names_of_robots in sorted(robots.items())],
    )


def out_of_view(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    """A sentence on the tasks whose target leaves the image of a fixed camera, "" if there are
    none."""
    rows = []
    for camera, name in camera_names(seen, summary).items():
        for task in sorted({one.spec.task for one in seen}):
            views = [
                one.target_in_view[camera]
                for one in seen
                if one.spec.task == task and camera in one.target_in_view
            ]
            if not views:
                continue
            frames, ends = np.concatenate(views).mean(), np.mean([view[-1] for view in views])
            if min(frames, ends) < IN_VIEW:
                rows.append([task, name, f"{100 * frames:.0f}", f"{100 * ends:.0f}"])
    head = (
        "task | camera | frames with the target in the image, % |"
        " episodes with it there at the end, %"
    )
    opening = (
        "In these tasks a camera does not show the target all the time, so that its images may not"
        " show the outcome:\n\n"
    )
    return opening + table(head, rows) if rows else ""
