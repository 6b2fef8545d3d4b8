"""JSON metadata of an episode file."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    field_validator,
    model_validator,
)

from pipeline.data.cameras import Camera, CameraType, look
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.imperfections import DriveErrors, Sensors
from pipeline.data.names import CAMERAS, RETIRED, is_name
from pipeline.data.parsing import unless
from pipeline.poses import Floats

from .events import DrawnEvent
from .visuals import Visuals


def _named(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"{text!r} is not a name")
    return text


def _family(text: str) -> str:
    if text.count(".") > 1 or not all(map(is_name, text.split("."))):
        raise ValueError(f"{text!r} is not a family, or a task and a family with a dot between")
    return text


Name = Annotated[str, AfterValidator(_named)]
"""It becomes a part of a path inside the file."""

Replaced = Annotated[str, AfterValidator(_family)]
"""A family that objects from files replace, or one task's: `cup`, `place_empty_cup.cup`."""

type Category = Literal["interception", "tracking"]

Side = Annotated[str, Field(pattern="^(left|right)$")]

CLUTTER = (3, 8)  # fewest and most distractors of the randomized domain, if there is room


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ObjectInfo(_Record):
    """A body in words: family, noun, description, and the instance's parameters."""

    family: str = ""
    noun: str = ""
    description: str = ""
    parameters: dict[str, bool | int | float | str] = {}


class CameraInfo(_Record):
    """Image size (px), vertical field of view (degrees), link (None: the world), pose (7,), x
    forward, y left, z up.
    """

    width: Annotated[int, Field(ge=1, le=8192, strict=True)]
    height: Annotated[int, Field(ge=1, le=8192, strict=True)]
    fovy: Annotated[float, Field(gt=0, lt=180, strict=True)]
    link: str | None
    pose: Annotated[tuple[float, ...], Field(min_length=7, max_length=7)]

    @classmethod
    def of(cls, camera: Camera) -> "CameraInfo":
        pose = tuple(map(float, camera.pose))
        return cls(**vars(camera.type), link=camera.link, pose=pose)

    def camera(self, name: str) -> Camera:
        at: Floats = np.array(self.pose)
        return Camera(name, CameraType(self.width, self.height, self.fovy), self.link, at)


FARTHEST = 100.0  # m from the origin of a camera's mount, at most
_Point = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Points(_Record):
    position: _Point
    look_at: _Point


class NamedCamera(CameraInfo):
    """A camera of a recipe besides the robot's own. `position` and `look_at`, points (m) in the
    link or the world, may replace the pose."""

    name: Name
    link: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _look_at(cls, values: Any) -> Any:
        """The pose of an upright camera for `position` and `look_at`."""
        if not isinstance(values, dict) or not {"position", "look_at"} & values.keys():
            return values
        if "pose" in values:
            raise ValueError("give a pose, or position and look_at, not both")
        given = _Points.model_validate(
            {k: values[k] for k in ("position", "look_at") if k in values}
        )
        forward = np.subtract(given.look_at, given.position)
        if not 1e-6 < np.linalg.norm(forward) < 2 * FARTHEST:
            raise ValueError("look_at is the position itself, or too far away")
        level = np.hypot(forward[0], forward[1]) > 1e-6 * abs(forward[2])
        # straight down or up, as of the head camera, the left of the image is -x
        left = (-forward[1], forward[0], 0.0) if level else (-1.0, 0.0, 0.0)
        rest = {key: value for key, value in values.items() if key not in ("position", "look_at")}
        return rest | {"pose": tuple(look(given.position, forward, left).tolist())}

    @field_validator("pose")
    @classmethod
    def _a_pose(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        """Within sight of the table, of a unit quaternion."""
        if (
            not np.all(np.abs(value) <= FARTHEST)
            or (length := float(np.linalg.norm(value[3:]))) < 1e-6
        ):
            raise ValueError(f"is not a pose x y z qw qx qy qz, all within {FARTHEST:g}")
        return (*value[:3], *(v / length for v in value[3:]))


def camera_name(camera: str | NamedCamera) -> str:
    """The name in an episode file."""
    return CAMERAS[camera] if isinstance(camera, str) else camera.name


class Drawing(_Record):
    """What the images were drawn with. `assets` maps visible bodies and "furniture" to hashes;
    {} if nothing was drawn.
    """

    preset: str
    visuals: Visuals
    cameras: dict[Name, CameraInfo] = {}
    assets: dict[Name, str] = {}
    sensors: Annotated[Sensors | None, unless(None)] = None

    @model_validator(mode="before")
    @classmethod
    def _without_retired(cls, values: Any) -> Any:
        """Drop the key of earlier versions for vendors' meshes."""
        if not isinstance(values, dict):
            return values
        return {key: value for key, value in values.items() if key != RETIRED}

    @property
    def latency(self) -> float:
        """How many frames the images are late."""
        return self.sensors.latency if self.sensors else 0.0


class FailureInfo(_Record):
    """Why a stored attempt was rejected."""

    attempt: Annotated[int, Field(ge=0)]
    stage: str
    reason: str
    detail: str = ""
    conditions: tuple[str, ...] = ()


class EpisodeMeta(_Record):
    """Everything about an episode that is not an array.

    `target` moves until the meeting, `manipulated` is what the arms handle, `arms` maps roles to
    sides, `choices` slots of the sentences to what the scene asks for ("red"), `choices_after` to
    what an event made of it, if it did. Of the distractors
    `clutter`, `clutter_wanted` were wanted at least and at most. `table_drop` (m) is how much
    higher than in the clean domain robot and head camera are. `meeting_time` (s) is planned; in a
    failed dry run it is the first touch, or the end. `corrects` names the policy that acts before
    the expert. Speeds (m/s) and `displacement` (m) are of the target's motion. `step_limit` counts
    control periods, `workspace` is x_min, x_max, y_min, y_max (m).

    `physics_key` and `render_key` name what it was made from (run/identity/slot_keys.py), `keys`
    their parts. `physics_id` is shared by all episodes of the same physics, which no split may
    separate; `variant` numbers their looks. Only failed attempts have a `failure`."""

    fps: Annotated[int, Field(gt=0)]
    target: Name
    manipulated: Name
    category: Category
    arms: dict[str, Side]
    choices: Annotated[dict[str, str], unless({})] = {}
    choices_after: Annotated[dict[str, str], unless({})] = {}
    objects: dict[Name, ObjectInfo]
    clutter: tuple[Name, ...] = ()
    clutter_wanted: Annotated[tuple[int, int], unless(CLUTTER)] = CLUTTER
    objects_wanted: Annotated[dict[Replaced, tuple[Name, ...]], unless({})] = {}
    table_drop: float = 0.0
    meeting_time: float
    average_speed: float
    maximum_speed: float
    end_speed: float = 0.0
    displacement: float = 0.0
    rules: str = "strict"
    contact: str = "stop"
    layout: str = "ours"
    drive: Annotated[DriveErrors | None, unless(None)] = None
    events: Annotated[tuple[DrawnEvent, ...], unless(())] = ()
    expert: Annotated[Literal["planned", "reactive"], unless("planned")] = "planned"
    corrects: Annotated[str, unless("")] = ""
    physics_hz: Annotated[int, Field(gt=0)] = PHYSICS_HZ
    step_limit: int = 0
    workspace: tuple[float, float, float, float] | None = None
    drawing: Drawing
    physics_id: str = ""
    variant: Annotated[int, Field(ge=0)] = 0
    failure: FailureInfo | None = None
    physics_key: str = ""
    render_key: str = ""
    keys: dict[str, dict[str, str]] = {}
