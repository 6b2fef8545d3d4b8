"""The sun's shadows, which all cameras share: depths drawn once per frame, and the resulting light
on table and floor."""

from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.episode.visuals import FIRST_LOOK, LOOK, SECOND_LOOK, THIRD_LOOK, Visuals
from pipeline.poses import Floats, Floats32, Pose
from pipeline.world.physics.body import TABLE_HALF, TABLE_THICKNESS, TABLE_TOP
from pipeline.world.shapes import Mesh, Parts, merge

from .masks import (
    ALL,
    BLOCK,
    FAR,
    Area,
    Blocks,
    Depths,
    Ground,
    Masks,
    compare,
    grown,
    hard,
    known,
    soft,
)
from .surfaces import embossed, opened


@dataclass(frozen=True)
class Look:
    """A way to compute images: shader suffix, planes' shadow masks, smoothing allowed, rounding of
    poses (m, 0: none), and whether our own rasteriser draws if there is no GPU."""

    shaders: str
    masks: Callable[[Depths, Ground, Masks | None, Area], Masks]
    prepare: Callable[[Parts], Parts]
    surface: Callable[[Parts, ArrayLike], Parts]
    edges: bool
    step: float = 0.0
    software: bool = False

    def rounded(self, poses: Floats) -> Floats:
        """Poses (...,7) as they are drawn."""
        return np.rint(poses / self.step) * self.step if self.step else poses


LOOKS = {
    FIRST_LOOK: Look("_first", hard, lambda parts: parts, lambda parts, _: parts, edges=False),
    SECOND_LOOK: Look("_second", soft, opened, embossed, edges=True),
    # an arm at rest trembles by 1e-9 m; a hundredth of a pixel is 1e-5 m at least
    THIRD_LOOK: Look("", soft, opened, embossed, edges=True, step=2.0**-17),
    LOOK: Look("", soft, opened, embossed, edges=True, step=2.0**-17, software=True),
}


def look_of(number: int) -> Look:
    """The look of that number. Raises ValueError for one that only a later version draws."""
    if number not in LOOKS:
        raise ValueError(f"look {number} is unknown: a later version drew this episode")
    return LOOKS[number]


# m; this and the next three are in shaders/common/sun.glsl too
SHADOW_CENTRE = (0.0, 0.0, TABLE_TOP)
SHADOW_HALF_SIZE = 0.85  # m, across the light
SHADOW_DEPTH = 1.2  # m to both sides of the centre, along the light
SHADOW_OFFSET = 0.004  # m off the surface that is looked up
SHADOW_MAP = 448  # texels a side
CASTER_CELL = 0.004  # m, about a texel of the map
POSE_STEP = 2.0**-14  # m, far below a texel; without it bodies at rest would tremble
SAME_STILL = 16  # frames


NOTHING: Blocks = np.zeros((3, SHADOW_MAP // BLOCK, SHADOW_MAP // BLOCK), np.bool_)
NOTHING.setflags(write=False)


class Casters(Protocol):
    """Draws bodies as the sun sees them: each one's far side, for a lit surface not to shade
    itself."""

    def place(self, name: str, pose: Pose) -> None: ...
    def show(self, names: Set[str], fixed: bool) -> None: ...
    def take(self, behind: Depths) -> Depths: ...
    def upload(self, depths: Depths, masks: Masks) -> None: ...
    def close(self) -> None: ...


class ShadowMap[C: Casters]:
    """Depths along the light, 0-1, and share of light on table and floor, which `draw` updates.

    `make` is given both; `changed` is what the last `draw` returned. Poses are rounded to
    POSE_STEP; bodies still for SAME_STILL frames are drawn once.
    """

    def __init__(
        self, visuals: Visuals, bodies: Iterable[str], make: Callable[[Depths, Masks], C]
    ) -> None:
        table, floor = (plane_depths(height, visuals.sun_direction) for height in (TABLE_TOP, 0.0))
        self._ground = Ground(table, floor, 2 * SHADOW_DEPTH, table_window(visuals.sun_direction))
        self._masks_of = look_of(visuals.look).masks
        self._bodies = frozenset(bodies)
        self._poses: dict[str, Floats] = {}
        self._movers: list[frozenset[str]] = []
        self._still = self._now = far = np.ones((SHADOW_MAP, SHADOW_MAP), np.float32)
        self._lit = self._masks_of(far, self._ground, None, ALL)
        self.casters = make(far, self._lit)
        self.changed = NOTHING

    def follow(self, poses: Mapping[str, Floats]) -> None:
        """Take the moving bodies' poses (F,7)."""
        self._poses = {name: np.rint(poses[name] / POSE_STEP) * POSE_STEP for name in self._bodies}
        frames = max((len(p) for p in self._poses.values()), default=1)
        moving, n = self._poses.items(), SAME_STILL
        self._movers = [
            frozenset(name for name, p in moving if np.ptp(p[k : k + n], axis=0).any())
            for k in range(0, frames, n)
        ]

    def draw(self, k: int) -> Blocks:
        """Update to frame `k`, in order from 0. Returns blocks (3,M,M) in which light on table, on
        floor, and depths changed."""
        self.changed = self._draw(k)
        return self.changed

    def _draw(self, k: int) -> Blocks:
        movers = self._movers[k // SAME_STILL]
        if k % SAME_STILL == 0:
            self._place(self._bodies - movers, k)
            self.casters.show(self._bodies - movers, fixed=True)
            self._still = self.casters.take(np.ones_like(self._now))
            self.casters.show(movers, fixed=False)
        elif not movers:
            return NOTHING
        depths = self._still
        if movers:
            self._place(movers, k)
            depths = self.casters.take(self._still)
        different = depths != self._now
        words = different.view(np.uint64)  # eight texels at once
        rows = np.flatnonzero(words.any(1))
        columns = np.flatnonzero(np.bitwise_or.reduce(words, 0).view(np.bool_))
        if not len(rows):
            return NOTHING
        area = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        touched = grown(area, FAR // 2, known(ALL, depths.shape))
        before = self._lit[touched].copy()
        self._masks_of(depths, self._ground, self._lit, area)
        corner = touched[0].start, touched[1].start
        compare(different, before, self._lit, corner, changed := NOTHING.copy())
        self._now = depths
        self.casters.upload(depths, self._lit)
        return changed

    def _place(self, names: Iterable[str], k: int) -> None:
        for name in names:
            self.casters.place(name, self._poses[name][k])


def caster(parts: Parts, cell: float) -> Mesh:
    """Shape for the shadow map: vertices in one cube of `cell` (m) become their mean. Normals and
    uvs are zero."""
    whole = merge([mesh for mesh, _ in parts])
    vertices = whole.vertices.astype(np.float64)
    cubes = np.floor(vertices / cell).astype(np.int64) + (1 << 20)
    keys = (cubes[:, 0] << 42) | (cubes[:, 1] << 21) | cubes[:, 2]
    _, index, count = np.unique(keys, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(index, vertices[:, k]) for k in range(3)], 1) / count[:, None]
    triangles = index[whole.triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)].astype(np.uint32)
    means = means.astype(np.float32)
    return Mesh(means, triangles, np.zeros_like(means), np.zeros((len(means), 2), np.float32))


def sun_map(direction: ArrayLike) -> Floats:
    """What takes world places to the map's column, row and depth, (3,4)."""
    texels = 0.5 * SHADOW_MAP / SHADOW_HALF_SIZE
    # the map is mirrored in x
    turn = sun_axes(direction) * np.array([[-texels], [texels], [0.5 / SHADOW_DEPTH]])
    middle = np.array([SHADOW_MAP / 2, SHADOW_MAP / 2, 0.5])
    return np.column_stack([turn, middle - turn @ SHADOW_CENTRE])


def sun_axes(direction: ArrayLike) -> Floats:
    """Rows (3,3): across the light twice, and along it; as in sun.glsl."""
    forward = np.asarray(direction, float) / np.linalg.norm(direction)
    right = np.cross((1.0, 0.0, 0.0) if abs(forward[0]) < 0.9 else (0.0, 1.0, 0.0), forward)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward], np.float64)


def table_window(direction: ArrayLike) -> tuple[slice, slice]:
    """Rows and columns of the map that light the table top, and FAR // 2 texels around."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 0)])
    corners = signs * (*TABLE_HALF, TABLE_THICKNESS) + signs * (SHADOW_OFFSET, SHADOW_OFFSET, 0)
    x, y = (corners @ sun_axes(direction)[:2].T / SHADOW_HALF_SIZE).T
    # the map is mirrored in x
    sides = [(np.array([at.min(), at.max()]) * 0.5 + 0.5) * SHADOW_MAP for at in (y, -x)]
    rows, columns = (
        slice(max(int(a) - FAR // 2 - 2, 0), min(int(b) + FAR // 2 + 3, SHADOW_MAP))
        for a, b in sides
    )
    return rows, columns


def plane_depths(height: float, direction: ArrayLike) -> Floats32:
    """Depth (SHADOW_MAP, SHADOW_MAP), at most 1, of light meeting z = `height` (m); 0: never."""
    right, up, forward = sun_axes(direction)[:, 2]
    across = ((np.arange(SHADOW_MAP) + 0.5) / SHADOW_MAP * 2 - 1) * SHADOW_HALF_SIZE
    distance = height + SHADOW_OFFSET - SHADOW_CENTRE[2]
    if abs(forward) < 1e-6:
        return np.zeros((SHADOW_MAP, SHADOW_MAP), np.float32)
    # the map is mirrored in x
    along = (distance + across[None] * right - across[:, None] * up) / forward
    return np.clip(along / SHADOW_DEPTH * 0.5 + 0.5, 0.0, 1.0).astype(np.float32)
