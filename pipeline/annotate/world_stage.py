"""The stage `world`: what the simulator knows of all bodies and of what one camera sees of them
(docs/labels.md has each array)."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.options import WorldOptions
from pipeline.annotate.stage import Reading, StageResult, Truth, check_camera
from pipeline.annotate.stage_key import AnnotateError
from pipeline.annotate.world_labels import boxes_3d, dense_motion, in_camera, point_tracks
from pipeline.data.episode.file import Episode, EpisodeFile
from pipeline.data.episode.world import WorldTruth, contact_forces, twists_of
from pipeline.data.keys import arrays_digest
from pipeline.data.names import HEAD

COMPRESSED = ("depth", "segmentation", "normals", "flow_forward", "flow_backward", "scene_flow")


@dataclass(frozen=True)
class WorldStage:
    """See pipeline.annotate.stage.Stage. `truth` gives what the simulator knows."""

    options: WorldOptions
    camera: str = HEAD
    truth: Truth | None = None

    name = "world"
    version = 1
    uses_models = False

    def parameters(self) -> dict[str, Any]:
        o = self.options
        return {"camera": self.camera, "points": o.points, "dense": o.dense}

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        check_camera(episode, self.camera)
        if self.truth is None:
            raise AnnotateError("the stage world needs the meshes of the dataset's assets")
        found, path, truth = episode.read(), episode.path, self.truth
        log, drawing = found.log, found.meta.drawing
        arrays = {"poses": log.poses, "times": log.times, "velocity": log.target_velocity}
        arrays |= {name: log.contacts[name] for name in ("frame", "a", "b", "impulse", "point")}
        inputs = {
            "scene": {"bodies": list(log.bodies), "state": arrays_digest(arrays)},
            "events": [[e.name, e.time] for e in log.events],
            "camera": drawing.cameras[self.camera].model_dump(mode="json"),
            "latency": drawing.latency,
            "objects": {n: o.model_dump(mode="json") for n, o in found.meta.objects.items()},
            "assets": drawing.assets,
        }
        return Reading(inputs, lambda: (found, truth(path, self.camera)))

    def start(self) -> Callable[[Any], StageResult]:
        return self.compute

    def compute(self, data: tuple[Episode, WorldTruth]) -> StageResult:
        """All labels of an episode."""
        (episode, truth), options = data, self.options
        log, meta, surfaces = episode.log, episode.meta, truth.surfaces
        late = log.late(meta.drawing.latency)
        drawn = [name for name in log.bodies if name in truth.bodies]
        facts = [truth.bodies[name] for name in drawn]
        seen = late.poses[:, [log.bodies.index(name) for name in drawn]]
        objects = [drawn.index(name) for name in truth.objects]
        contacts, met = log.contacts, log.time_of("meeting")
        place = meta.meeting_time if met is None else met
        arrays: dict[str, Any] = {
            "pose": log.poses.astype(np.float32),
            "twist": twists_of(log, meta.target).astype(np.float32),
            "contact_frame": contacts["frame"],
            "contact_bodies": np.stack([contacts["a"], contacts["b"]], 1),
            "contact_force": contact_forces(log, meta.physics_hz).astype(np.float32),
            "contact_point": contacts["point"],
            "time_to_contact": (place - log.times).astype(np.float32),
            "box_2d": truth.box,
            "box_3d": boxes_3d(surfaces, seen[:, objects], [facts[i] for i in objects]).astype(
                np.float32
            ),
            "visible_share": truth.visible,
        }
        arrays |= point_tracks(surfaces, seen, facts, options.points)
        position = episode.interception.get(
            "meeting_position", episode.interception.get("planned_position")
        )
        if position is not None:
            xyz, xy = in_camera(surfaces, position)
            arrays |= {"meeting_XYZ": xyz.astype(np.float32), "meeting_XY": xy.astype(np.float32)}
        if options.dense:
            arrays |= {
                "depth": surfaces.depth,
                "segmentation": surfaces.segmentation,
                "normals": surfaces.normals,
                **dense_motion(surfaces, late.poses),
            }
        return StageResult(
            arrays,
            {
                "bodies": list(log.bodies),
                "objects": list(truth.objects),
                "tracked": drawn,
                "mass": {n: f.mass for n, f in truth.bodies.items() if f.mass is not None},
                "friction": {
                    n: f.friction for n, f in truth.bodies.items() if f.friction is not None
                },
                "size": {
                    n: np.ptp(f.vertices, axis=0).round(6).tolist() for n, f in truth.bodies.items()
                },
                "met": met is not None,
            },
            COMPRESSED if options.dense else (),
        )
