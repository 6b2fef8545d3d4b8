"""Images as a pure function of state log, appearance and sensors."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.data.cameras import Camera, View
from pipeline.data.episode.events import DrawnEvent, spans
from pipeline.data.episode.file import Episode
from pipeline.data.episode.meta import CameraInfo, Drawing
from pipeline.data.episode.state_log import StateLog
from pipeline.data.episode.visuals import Visuals
from pipeline.data.imperfections import Sensors
from pipeline.data.names import HEAD
from pipeline.data.setup import DEFAULT, Setup
from pipeline.data.setup.brought import Brought, light_of, textures_of
from pipeline.data.slots.assets import AssetError, AssetStore
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Floats, Floats32
from pipeline.world.cameras import CameraError, check_links, setup_cameras, wanted_cameras
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.sensing import Sensing, point_clouds
from pipeline.world.looks.materials import load_parts, store_parts
from pipeline.world.looks.textures import Rgba
from pipeline.world.looks.visuals import CLEAN, IMAGE, draw_visuals, lit_by, with_textures
from pipeline.world.physics.body import parts_of
from pipeline.world.shapes import Material, Mesh, Parts

from .exposure import Lapses, photograph


def sensing_of(
    spec: EpisodeSpec, sensors: Sensors | None, fps: int, variant: int = 0
) -> Sensing | None:
    """The sensors of one look of an episode, with a random stream of its own."""
    return sensors and Sensing(sensors, int(spec.rng(f"sensors/{variant}").integers(2**63)), fps)


if TYPE_CHECKING:  # a stored episode is drawn without tasks and robots
    from pipeline.stages.scene import Scene

FURNITURE = "furniture"  # asset name of what is still around the robot
SURFACE = "surface_"  # how asset names of the room's textures begin


@dataclass(frozen=True, eq=False)
class Appearance:
    """What images are drawn from, besides poses; `bodies` as in `StateLog.bodies`, no table."""

    bodies: Mapping[str, Parts]
    furniture: Parts
    cameras: tuple[Camera, ...]
    visuals: Visuals
    preset: str = "raster"
    sensing: Sensing | None = None
    images: Mapping[str, Rgba] = field(default_factory=dict)
    events: tuple[DrawnEvent, ...] = ()

    def seen_by(self, *names: str) -> "Appearance":
        return replace(self, cameras=tuple(c for c in self.cameras if c.name in names))


def visuals_of(
    spec: EpisodeSpec, setup: Setup = DEFAULT, variant: int = 0, frozen: Visuals | None = None
) -> Visuals:
    """The look of an episode's room and lights, with a random stream for every seed and variant.
    Textures and light of the setup replace it. Raises BroughtError.
    """
    own = setup.visuals != "domain"
    if frozen and not own and (spec.domain == "clean" or setup.textures == "unseen"):
        visuals = frozen
    elif (setup.visuals if own else spec.domain) == "clean":
        visuals = CLEAN
    else:
        split = setup.textures if isinstance(setup.textures, str) else "seen"
        stream = f"visuals/{setup.visual_seed}/{variant}" if own else "visuals"
        visuals = draw_visuals(spec.rng(stream), split)
    if isinstance(setup.textures, Brought):
        rng = spec.rng(f"textures/{setup.visual_seed}/{variant}")
        visuals = with_textures(visuals, textures_of(setup.textures), rng)
    return lit_by(visuals, light_of(setup.environment)) if setup.environment else visuals


def surface_images(visuals: Visuals, setup: Setup) -> dict[str, Rgba]:
    """The textures of visuals that the setup brings, by kind."""
    if not isinstance(setup.textures, Brought):
        return {}
    found = textures_of(setup.textures)
    surfaces = {"table": visuals.table, "wall": visuals.wall, "floor": visuals.ground}
    return {
        kind: found[kind][surface.seed][0]
        for kind, surface in surfaces.items()
        if surface.pattern == IMAGE
    }


def appearance_of(scene: "Scene", setup: Setup = DEFAULT) -> Appearance:
    """What the first look of a spec's scene is drawn from."""
    robot = scene.embodiment
    bodies: dict[str, Parts] = {
        name: body.instance.shape().visual for name, body in scene.bodies.items()
    }
    for side, arm in robot.arms.items():
        bodies |= {f"{side}_{link.name}": link.visual for link in arm.links}
    bodies |= {prop.name: parts_of(prop) for prop in scene.scenery}
    cameras = setup_cameras(robot, setup)
    sensing = sensing_of(scene.spec, setup.sensors, setup.fps)
    visuals = visuals_of(scene.spec, setup, frozen=scene.looks)
    images = surface_images(visuals, setup)
    looks = visuals, setup.render, sensing, images
    return Appearance(bodies, robot.furniture, cameras, *looks, scene.events)


def with_setup(
    appearance: Appearance,
    setup: Setup,
    visuals: Visuals,
    sides: Collection[str],
    sensing: Sensing | None,
) -> Appearance:
    """The appearance with a setup's preset and cameras and these looks. Raises CameraError."""
    cameras = wanted_cameras(appearance.cameras, setup, sides)
    return replace(
        appearance, cameras=cameras, preset=setup.render, visuals=visuals, sensing=sensing
    )


def keep(appearance: Appearance, store: AssetStore) -> Drawing:
    """Keep what an episode is drawn from; the record of it. Raises OSError."""
    shown = {name: parts for name, parts in appearance.bodies.items() if parts} | {
        FURNITURE: appearance.furniture
    }
    return Drawing(
        preset=appearance.preset,
        visuals=appearance.visuals,
        cameras={c.name: CameraInfo.of(c) for c in appearance.cameras},
        assets={name: store_parts(store, parts) for name, parts in shown.items()}
        | keep_images(appearance.images, store),
        sensors=appearance.sensing and appearance.sensing.sensors,
    )


def keep_images(images: Mapping[str, Rgba], store: AssetStore) -> dict[str, str]:
    """Keep textures as parts without triangles; their hashes by asset name."""
    none = np.zeros((0, 3), np.float32)
    empty = Mesh(none, np.zeros((0, 3), np.uint32), none)
    parts = {
        kind: [(empty, Material((1.0, 1.0, 1.0), 1.0, 0.0, image))]
        for kind, image in images.items()
    }
    return {f"{SURFACE}{kind}": store_parts(store, held) for kind, held in parts.items()}


def stored_appearance(
    episode: Episode, store: AssetStore, load: Callable[[AssetStore, str], Parts] = load_parts
) -> Appearance:
    """What a stored episode was drawn from. Raises AssetError."""
    drawing = episode.meta.drawing
    if not drawing.assets:
        raise AssetError("the episode names no assets, so it cannot be drawn again")
    bodies: dict[str, Parts] = {}
    for name in episode.log.bodies:
        key = drawing.assets.get(name)
        if name != "table":
            bodies[name] = () if key is None else load(store, key)
    furniture = load(store, drawing.assets[FURNITURE]) if FURNITURE in drawing.assets else ()
    cameras = tuple(info.camera(name) for name, info in drawing.cameras.items())
    sensing = sensing_of(episode.spec, drawing.sensors, episode.meta.fps, episode.meta.variant)
    surfaces = {
        name.removeprefix(SURFACE): load(store, key)
        for name, key in drawing.assets.items()
        if name.startswith(SURFACE)
    }
    images = {
        kind: pixels
        for kind, parts in surfaces.items()
        for _, m in parts
        if (pixels := m.texture) is not None
    }
    looks = drawing.visuals, drawing.preset, sensing, images
    return Appearance(bodies, furniture, cameras, *looks, episode.meta.events)


def renderer(appearance: Appearance) -> Renderer:
    """A renderer of the appearance, to be closed."""
    a = appearance
    return Renderer(a.bodies, a.furniture, a.cameras, a.visuals, a.preset, a.images)


def body_poses(log: StateLog) -> dict[str, Floats]:
    """Poses (T,7) of all bodies."""
    return {name: log.poses[:, i] for i, name in enumerate(log.bodies)}


def render(
    appearance: Appearance,
    log: StateLog,
    *,
    depth: bool = False,
    segmentation: bool = False,
    frames: Sequence[int] | None = None,
) -> list[View]:
    """Images of every frame, or of some, from every camera, by perfect sensors."""
    with renderer(appearance) as drawing:
        return drawing.render(body_poses(log), frames, depth=depth, segmentation=segmentation)


@dataclass(eq=False)
class Capture:
    """What cameras captured, and point clouds (T,N,6) if they are wanted."""

    views: list[View]
    pointcloud: Floats32 | None = None


def capture(
    appearance: Appearance, log: StateLog, setup: Setup, frames: Sequence[int] | None = None
) -> Capture:
    """What the sensors show at all or some frames. Raises CameraError."""
    check_links(appearance.cameras, log.bodies)
    wanted = {"depth": setup.depth or setup.pointcloud, "segmentation": setup.segmentation}
    lapses = Lapses(spans(appearance.events, log.events), setup.fps)
    frames = frames or range(len(log))
    with renderer(appearance) as drawing:
        poses = body_poses(log)
        views = photograph(drawing, poses, frames, appearance.sensing, lapses, **wanted)
    if not setup.pointcloud:
        return Capture(views)
    head = next((view for view in views if view.camera.name == HEAD), None)
    if head is None:
        raise CameraError("a point cloud needs the head camera: add head to the cameras")
    clouds = point_clouds(head)
    return Capture(views if setup.depth else [replace(view, depth=None) for view in views], clouds)
