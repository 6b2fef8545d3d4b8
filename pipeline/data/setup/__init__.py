"""A setup: cameras, sensors, rate and rules of a dataset, an evaluation or a policy."""

from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.episode.events import Events
from pipeline.data.episode.meta import CLUTTER, Name, NamedCamera, Replaced, camera_name
from pipeline.data.errors import DominoError
from pipeline.data.imperfections import DriveErrors, Sensors
from pipeline.data.names import MOUNTED, RETIRED, SIDES
from pipeline.data.parsing import FEWEST_PIXELS, MOST_PIXELS

from .brought import Brought
from .rules import MOST_CLUTTER, Contact, Layout, Rules, RuleSet, Sight
from .written import (
    check_kind,
    explain,
    read_cameras,
    read_light,
    read_objects,
    read_size,
    read_textures,
)

IMAGES = (
    *("render", "depth", "segmentation", "pointcloud", "cameras", "size", "sensors"),
    *("visuals", "visual_seed", "textures", "environment"),
)
"""Keys that decide how images look; the others decide what happens in them."""

INTERFACE = ("fps", "layout", "camera", "cameras", "size", "depth", "segmentation", "pointcloud")
"""Keys that a policy is made for: what it sees, and what its actions mean."""

SETUP_FILE = "setup.yaml"  # of a trained policy: the setup it was made for

MOST_SEED = 2**63 - 1

Seed = Annotated[int, Field(ge=0, le=MOST_SEED, strict=True)]
_Pixels = Annotated[int, Field(ge=FEWEST_PIXELS, le=MOST_PIXELS, strict=True)]


class RecipeError(DominoError, ValueError):
    """A recipe or setup that cannot be used: one line with the key and the fix."""


class Setup(BaseModel):
    """All that a recipe says but which episodes to make. Without cameras nothing is drawn."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    fps: Literal[5, 10, 12, 15, 20, 24, 30, 40, 48, 60] = DEFAULT_FPS
    """Recorded frames and actions per second."""
    camera: Literal["L515", "Large_L515", "D435", "Large_D435"] = "D435"
    """Type of the mounted cameras: image size and field of view."""
    render: Literal["raster", "raster-fast", "rt"] = "raster"
    """Preset of the renderer; `rt` is ray-traced, about a hundred times slower on a CPU."""
    depth: bool = False
    """Store depth images (mm)."""
    segmentation: bool = False
    """Store which body each pixel shows."""
    cameras: Annotated[tuple[str | NamedCamera, ...], BeforeValidator(read_cameras)] = MOUNTED
    """Cameras that are stored: head, left, right, observer, and cameras described in full."""
    size: Annotated[tuple[_Pixels, _Pixels] | None, BeforeValidator(read_size)] = None
    """Width and height of all images (pixels), if not the cameras' own; the vertical field of view
    stays the same."""
    pointcloud: bool = False
    """Store a point cloud of the head camera."""
    sensors: Sensors | None = None
    """Imperfections of the cameras, off by default: noise (gain), motion_blur (ms), drift (share),
    depth_noise (d435), latency (frames), as in noise=2,latency=1; in a file also {noise: 2,
    latency: 1}."""
    visuals: Literal["domain", "clean", "randomized"] = "domain"
    """Looks of room and lights: those of the episode's domain, the clean ones, or drawn from
    `visual_seed`."""
    visual_seed: Seed = 0
    """Seed of the looks, if visuals are randomized."""
    lead: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Seconds that the target moves before the robot starts."""
    start: Literal["early", "late"] | None = None
    """When targets start: `early` as the episode starts (or `lead` s before), or `late`, when their
    path has room at the speed drawn. The default is `late` with strict rules and an alpha above
    0.1, else `early`."""
    jumps: Literal["drawn", "capped"] | None = None
    """Jumps of a level-3 target's velocity at an instant: as the law draws them, or `capped` at 4
    alpha. The default is `capped` with strict rules and an alpha above 0.1, else `drawn`."""
    motion: Name | None = None
    """Model of the targets' motions, if not the task's own; the paper's is `planar`."""
    speed_bound: Literal["average", "maximum"] = "average"
    """The speed that alpha bounds at levels 2 and 3: the average (as in the paper's appendix) or
    the maximum."""
    rules: RuleSet = "strict"
    """Sizes, tolerances and conditions: strict (ours), or domino (the original's)."""
    contact: Contact | None = None
    """What the first touch does to the motion of the target, if not what the rules define."""
    layout: Layout = "ours"
    """Places of the robots' bases: ours, or those of the original system."""
    drive: Annotated[
        DriveErrors | None, AfterValidator(lambda d: d if d != DriveErrors() else None)
    ] = None
    """How joints differ from their commands, off by default: lag (s), noise (rad) and backlash
    (rad), as in lag=0.03,noise=0.002,backlash=0.001; in a file also {lag: 0.03}."""
    clutter: tuple[
        Annotated[int, Field(ge=0, strict=True)],
        Annotated[int, Field(le=MOST_CLUTTER, strict=True)],
    ] = CLUTTER
    """Fewest and most distractors in the randomized domain, at most 10; fewer if there is no
    room."""
    objects: Annotated[
        Mapping[Replaced, Annotated[tuple[Name, ...], Field(min_length=1)]],
        BeforeValidator(read_objects),
    ] = Field(default_factory=dict)
    """Objects from files in place of object families, e.g. mug=mug7,mug=mug8, or of one task's,
    e.g. place_empty_cup.cup=cup3."""
    textures: Annotated[Literal["seen", "unseen"] | Brought, BeforeValidator(read_textures)] = (
        "seen"
    )
    """Textures of randomized looks: those of training (seen), or those kept for evaluation
    (unseen); or a directory of your images, for every look."""
    events: Events = ()
    """What happens while the robot acts, none by default: KIND@WHEN, as in stop@0.8 or
    occluder@share=0.6; in a file also {kind: stop, when: {time: 0.8}}."""
    environment: Annotated[Brought | None, BeforeValidator(read_light)] = None
    """An equirectangular image (.hdr) whose light replaces the lights of every look."""

    @model_validator(mode="before")
    @classmethod
    def _without_retired(cls, values: Any) -> Any:
        """Drop keys without effect that earlier versions stored."""
        if not isinstance(values, Mapping):
            return values
        retired = {"floor", *([RETIRED] if values.get(RETIRED) == {} else [])}
        return {key: value for key, value in values.items() if key not in retired}

    @field_validator("*", mode="before")
    @classmethod
    def _plain(cls, value: Any, info: ValidationInfo) -> Any:
        check_kind(value, info.field_name in ("depth", "segmentation", "pointcloud"))
        return value

    @field_validator("clutter")
    @classmethod
    def _fewest_first(cls, value: tuple[int, int]) -> tuple[int, int]:
        if value[0] > value[1]:
            raise ValueError("must be [fewest, most], such as [3, 8]")
        return value

    @field_validator("sensors")
    @classmethod
    def _within_a_frame(cls, value: Sensors | None, info: ValidationInfo) -> Sensors | None:
        """The shutter is open for a frame at most; sensors without imperfections are none."""
        frame = 1000 / info.data.get("fps", DEFAULT_FPS)
        if value is not None and value.motion_blur > frame:
            raise ValueError(f"has a motion_blur longer than a frame, {frame:.1f} ms")
        return value if value != Sensors() else None

    @field_validator("pointcloud")
    @classmethod
    def _of_the_head_camera(cls, value: bool, info: ValidationInfo) -> bool:
        if value and "head" not in info.data.get("cameras", ("head",)):
            raise ValueError("is made of the head camera's images: add head to the cameras")
        return value

    def __hash__(self) -> int:
        return hash(self.model_dump_json())

    @property
    def setup(self) -> "Setup":
        """The setup alone, also of a recipe."""
        return Setup.model_construct(**{name: getattr(self, name) for name in Setup.model_fields})

    @property
    def physics(self) -> "Setup":
        """The setup with all keys of IMAGES at their defaults: what decides scenes and experts."""
        return Setup.model_construct(
            **{name: getattr(self, name) for name in Setup.model_fields if name not in IMAGES}
        )

    @property
    def calm(self) -> "Setup":
        """Physics without events, by which the scenes of an evaluation are admitted."""
        return self.physics.model_copy(update={"events": ()})

    @property
    def brought(self) -> tuple[str, str]:
        """Textures and light: a split or content; "" for no light."""
        own = (self.textures, self.environment or "")
        return tuple(each.content if isinstance(each, Brought) else each for each in own)  # pyright: ignore[reportReturnType]

    @property
    def reactive(self) -> Sight | None:
        """How the reactive expert that demonstrates sees."""
        return None

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras by their names in an episode file."""
        return tuple(map(camera_name, self.cameras))

    def ruling(self) -> Rules:
        objects = tuple(sorted(self.objects.items()))
        given = (self.rules, self.contact, self.layout, self.clutter, objects, self.drive)
        return Rules(*given, self.events)

    @property
    def label(self) -> str:
        """A word for paths and tables: the rules, and what else of `physics` is no default."""
        keys = ("camera", "lead", "start", "jumps", "motion", "speed_bound")
        words = {key: getattr(self, key) for key in keys}
        words |= {"fps": f"{self.fps}hz", "lead": f"lead{self.lead:g}"}
        default = Setup()
        changed = [k for k in ("fps", *keys) if getattr(self, k) != getattr(default, k)]
        return "-".join((self.ruling().label, *(str(words[key]) for key in changed)))

    def given(self) -> dict[str, Any]:
        """The keys that are not at their defaults (JSON); `parse` is the inverse."""
        return self.setup.model_dump(mode="json", exclude_defaults=True)

    def override(
        self,
        values: Mapping[str, Any],
        source: str = "options",
        flags: Mapping[str, str] | None = None,
    ) -> Self:
        """The same with other values of some keys. Raises RecipeError as `parse`."""
        return self.parse(self.model_dump() | dict(values), source, flags)

    @classmethod
    def parse(
        cls,
        values: Mapping[str, Any],
        source: str = "setup",
        flags: Mapping[str, str] | None = None,
    ) -> Self:
        """A checked model. Raises RecipeError in one line with `source` and the key, or its option
        (`flags`)."""
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise RecipeError(explain(error, cls, values, source, flags or {})) from error


DEFAULT = Setup()  # of a bare `build`


def option_of(key: str) -> str:
    """The command-line option of a key."""
    name = {"embodiments": "embodiment", "camera": "camera-type"}.get(key, key)
    return f"--{name.replace('_', '-')}"
