"""An episode as a recording of rerun (.rrd): cameras, states and actions, target and hands in
space, events."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.episode.file import open_episode
from pipeline.data.errors import DominoError

APPLICATION = "domino-data"


class MissingRerun(DominoError):
    """rerun cannot be imported; the message names the package to install."""


def log_episode(path: Path, name: str, out: Path) -> Path:
    """Write the recording of an episode, called `name`, to `out` and return it. Raises
    MissingRerun, EpisodeError, OSError."""
    try:
        import rerun as rr
    except ImportError as error:
        raise MissingRerun(f"--rerun needs rerun ({error}): install domino-data[viz]") from error
    out.parent.mkdir(parents=True, exist_ok=True)
    recording: Any = rr.RecordingStream(APPLICATION, recording_id=name)
    recording.save(out)
    with open_episode(path) as e:
        episode = e.read()
        log, target = episode.log, episode.log.pose(episode.meta.target)[:, :3]
        coded = {camera: e.array(f"observation/{camera}/rgb").tolist() for camera in e.cameras}
    recording.log("world/target/path", rr.LineStrips3D([target.astype(np.float32)]), static=True)
    for t, time in enumerate(log.times):
        recording.set_time("time", duration=float(time))
        recording.set_time("frame", sequence=t)
        for camera, images in coded.items():
            recording.log(
                f"cameras/{camera}", rr.EncodedImage(contents=images[t], media_type="image/jpeg")
            )
        recording.log("world/target", rr.Points3D([target[t]], radii=0.01))
        for i, side in enumerate(log.sides):
            recording.log(f"world/{side}_hand", rr.Points3D([log.tcp[t, i, :3]], radii=0.01))
        for kind, values in (("state", log.state), ("action", log.action)):
            for joint, value in zip(log.vector_names, values[t], strict=True):
                recording.log(f"joints/{joint}/{kind}", rr.Scalars(float(value)))
    for event in log.events:
        recording.set_time("time", duration=event.time)
        recording.log("events", rr.TextLog(f"{event.name} {event.by}".strip()))
    recording.flush()
    recording.disconnect()
    return out
