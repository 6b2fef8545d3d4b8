"""`domino-data check-object NAME`."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np
import sapien

from pipeline.data.process.own_code import Finding, catch_errors
from pipeline.intake.objects.draft import TRIANGLES as OF_A_FILE
from pipeline.intake.objects.standing import inside, instance_of
from pipeline.poses import Pose, pose, quat_rotate
from pipeline.world.objects.contract import FAMILIES, Family, Grasp, stands_for
from pipeline.world.objects.words import SEEN, UNSEEN
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.scene_building import add_body, add_table
from pipeline.world.shapes import Collider, Shape

INSTANCES, BUILT = 20, 5  # instances drawn, and how many of them are built and put on a table
TRIANGLES = 800
FIT = 0.009  # m that the drawn shape and the collision pieces may differ by along each axis
WIDEST = 0.075  # m between the fingers: what every robot's jaws can open to
SLACK = 0.003  # m by which a grasp's `width` may miss the material
AROUND, STEP = 0.01, 0.00025  # m beyond the pads that are looked at, and how finely
# m in front of the tcp, inside the pads, where a grasp may meet material
AHEAD = (0.0, 0.004, 0.008, 0.012)
ROOM, SHALLOW, OFF = 0.015, 0.3, 0.002
"""m before a frame that make a hollow of a family, the share of it that an object needs, and m
between tested points."""

SECONDS = 1.0

type Problems = Callable[[Family, Shape], Iterator[str]]


def check_object(name: str) -> list[Finding]:
    return [*catch_errors("family", FAMILIES[name], lambda: _check(name, FAMILIES[name]))]


def _check(name: str, family: type[Family]) -> list[Finding]:
    model = stands_for(family)
    # an object from files is always the same, and has the words that its user gave it
    drawn = [instance_of(name, seed) for seed in range(1 if model else INSTANCES)]
    built = [(one, one.shape()) for one in drawn[:BUILT]]
    frames, most = built[0][0].frames(), OF_A_FILE if model else TRIANGLES
    kinds = ", ".join(sorted({g.kind for g in frames.grasps}))
    held = f"{len(frames.grasps)}, of kinds {kinds}"
    if not kinds:
        held = "none: it can only be pressed or put on"

    def of_each(name: str, problems: Problems, good: str, count: int = BUILT) -> Finding:
        found = (f"{a}: {problem}" for a, shape in built[:count] for problem in problems(a, shape))
        return _judge(name, found, good)

    good = f"at most {most} triangles, finite, with unit normals"
    solid = [
        of_each("meshes", partial(_meshes, most), good),
        of_each("shape", _fit, "stands on z = 0; what is drawn and what is solid agree"),
        of_each("frames", _frames, ", ".join(frames.points)),
    ]
    grasps = of_each("grasps", _grasps, held, 2)
    rest = of_each("rest", partial(_rest, name), "rests where it is put")
    if model:
        hollows = of_each("hollows", partial(_hollows, model), "hollow where its family is")
        return [*solid, hollows, grasps, rest]
    always = f"{INSTANCES} seeds draw {INSTANCES} instances, each always the same"
    words = _judge("words", _words(drawn), f"{SEEN} seen and {UNSEEN} unseen descriptions")
    return [_judge("drawing", _drawing(name, drawn), always), *solid, grasps, words, rest]


def _judge(name: str, problems: Iterable[str], good: str) -> Finding:
    first = next(iter(problems), None)
    return Finding(name, first is None, first or good)


def _drawing(name: str, drawn: Sequence[Family]) -> Iterator[str]:
    if list(drawn) != [instance_of(name, seed) for seed in range(INSTANCES)]:
        yield "the same seed draws another instance: draw from `rng` only, in a frozen dataclass"
    different = len(set(drawn))
    if different < INSTANCES:
        yield f"{INSTANCES} seeds draw {different} instances: draw its sizes and colours from `rng`"


def _meshes(most: int, one: Family, shape: Shape) -> Iterator[str]:
    count = sum(len(mesh.triangles) for mesh, _ in shape.visual)
    if count > most:
        yield f"{count} triangles are drawn: {most} at most, so that frames stay cheap"
    for mesh, material in shape.visual:
        if not np.isfinite(mesh.vertices).all() or mesh.triangles.max() >= len(mesh.vertices):
            yield "a mesh has vertices that are not finite, or triangles of vertices beyond them"
        if np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() > 1e-4:
            yield "a mesh has normals that are not of length 1"
        if material.texture is not None and mesh.uvs is None:
            yield "a mesh with a texture has no uvs"


def _fit(one: Family, shape: Shape) -> Iterator[str]:
    points = np.concatenate([mesh.vertices for mesh, _ in shape.visual])
    seen, solid = np.stack([points.min(0), points.max(0)]), shape.aabb()
    if abs(seen[0, 2]) > 1e-3 or abs(solid[0, 2]) > 1.5e-3:
        drawn, below = seen[0, 2], solid[0, 2]
        yield f"its lowest point is at z = {drawn:.4f} m drawn, {below:.4f} m solid, not at z = 0"
    apart = np.maximum(solid[0] - seen[0], seen[1] - solid[1]).max()
    if apart > FIT:
        most = f"{1000 * FIT:.0f} mm at most"
        yield f"what is drawn reaches {1000 * apart:.0f} mm out of its collision pieces: {most}"
    if not (0.001 < shape.mass < 12 and 0.2 <= shape.friction <= 1.0):
        given = f"mass {shape.mass:.4g} kg, friction {shape.friction:g}"
        yield f"{given}: 0.001 to 12 kg and 0.2 to 1 are sensible"


def _frames(one: Family, shape: Shape) -> Iterator[str]:
    points, (lower, upper) = one.frames().points, shape.aabb()
    if missing := {"base", "top"} - points.keys():
        names = " and no frame ".join(sorted(missing))
        yield f"has no frame {names}: every object has base (the origin) and top"
        return
    if np.abs(points["base"] - pose((0, 0, 0))).max() > 1e-9:
        yield "its frame base is not the origin: mark(0, 0, 0)"
    if abs(points["top"][2] - upper[2]) > FIT:
        top = points["top"][2]
        yield f"its frame top is at z = {top:.3f} m, the object ends at {upper[2]:.3f} m"
    for label, p in points.items():
        off = np.any((p[:3] < lower - 0.01) | (p[:3] > upper + 0.01))
        if off or abs(np.linalg.norm(p[3:]) - 1) > 1e-9:
            yield f"its frame {label} lies more than 1 cm off the object, or is no unit quaternion"


def _hollows(family: str, one: Family, shape: Shape) -> Iterator[str]:
    model = instance_of(family)
    theirs, own = model.frames().points, one.frames().points
    for label in theirs.keys() & own.keys() - {"base", "top"}:
        usual, free = (
            free_before(s, points[label]) for s, points in ((model.shape(), theirs), (shape, own))
        )
        if usual >= ROOM and free < usual * SHALLOW:
            here = f"{1000 * free:.0f} mm are free before its frame {label}"
            there = f"{1000 * usual:.0f} mm in a {family}"
            yield f"{here}, {there}: use another --family, or correct the frame"


def free_before(shape: Shape, at: Pose) -> float:
    """Free way (m) along a frame's normal to the bounding box, or 0."""
    lower, upper = shape.aabb()
    normal = quat_rotate(at[3:], np.array([0.0, 0.0, 1.0]))
    steps = np.arange(OFF, float(np.linalg.norm(upper - lower)), OFF)
    points = at[:3] + steps[:, None] * normal
    within = np.all((points > lower) & (points < upper), axis=1)
    return 0.0 if inside(shape.collision, points[within]).any() else OFF * int(within.sum())


def _grasps(one: Family, shape: Shape) -> Iterator[str]:
    for g in one.frames().grasps:
        if not 0 < g.width <= WIDEST:
            yield f"a grasp of kind {g.kind} is {g.width:.3f} m wide: above 0, {WIDEST} m at most"
        elif not any(_holds(shape.collision, g, ahead) for ahead in AHEAD):
            at = ", ".join(f"{x:.3f}" for x in g.pose[:3])
            what = (
                f"a grasp of kind {g.kind} at ({at}) m holds nothing {1000 * g.width:.1f} mm wide"
            )
            yield f"{what}: along y the collision pieces must end so far to either side of the tcp"


def _holds(pieces: Sequence[Collider], g: Grasp, ahead: float) -> bool:
    """Whether material ends, within SLACK, at both pads."""
    approach, opening = quat_rotate(g.pose[3:], np.eye(3)[:2])
    offsets = np.arange(-g.width / 2 - AROUND, g.width / 2 + AROUND, STEP)
    points = g.pose[:3] + ahead * approach + offsets[:, None] * opening
    solid = offsets[inside(pieces, points)]
    return len(solid) > 0 and bool(
        max(abs(solid[0] + g.width / 2), abs(solid[-1] - g.width / 2)) < SLACK
    )


def _words(drawn: Sequence[Family]) -> Iterator[str]:
    for one in drawn:
        try:
            words = one.words()
        except ValueError as error:
            yield str(error)
            continue
        phrases = (*words.seen, *words.unseen)
        counts, different = (len(words.seen), len(words.unseen)), len(set(phrases))
        if counts != (SEEN, UNSEEN) or different < len(phrases):
            seen, unseen = counts
            yield f"{one}: {seen} seen and {unseen} unseen descriptions, {different} different ones"
        if words.noun not in words.seen:
            yield f"{one}: its noun {words.noun!r}, which detectors need, is no seen description"
        articles = ("a ", "an ", "the ")
        for phrase in phrases:
            if phrase != phrase.strip() or "{" in phrase or phrase.lower().startswith(articles):
                yield f"{one}: {phrase!r} begins with an article, or has a slot or spaces left over"


def _rest(name: str, one: Family, shape: Shape) -> Iterator[str]:
    body = Body(name, name, one, pose((0, 0, TABLE_TOP)))
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 240)
    add_table(scene)
    entity = add_body(scene, body, body.pose)
    for _ in range(round(240 * SECONDS)):
        scene.step()
    at: Pose = np.concatenate([entity.pose.p, entity.pose.q]).astype(float)
    up = quat_rotate(at[3:], np.array([0.0, 0.0, 1.0]))[2]
    tilt = float(np.degrees(np.arccos(np.clip(up, -1, 1))))
    moved = float(np.linalg.norm(at[:2] - body.pose[:2]))
    if moved > 0.005 or tilt > 2.0:
        what = f"moves by {1000 * moved:.0f} mm and tilts by {tilt:.0f} degrees in {SECONDS:g} s"
        yield f"put on a table it {what}: give it a flat base of collision pieces"
