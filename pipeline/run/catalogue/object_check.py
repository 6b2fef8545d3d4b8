"""`domino-data check-object NAME`: does an object family keep its contract (world/objects/contract.py)? No robot, no images."""

from collections.abc import Iterator, Sequence

import numpy as np
import sapien

from pipeline.data.findings import Finding, catch_errors
from pipeline.poses import Pose, pose, quat_rotate
from pipeline.run.objects.solid import inside
from pipeline.run.objects.standing import first_of
from pipeline.run.objects.thinning import TRIANGLES as OF_A_FILE
from pipeline.world.body import TABLE_TOP, Body
from pipeline.world.objects.contract import FAMILIES, Family, Grasp, stands_for
from pipeline.world.objects.words import SEEN, UNSEEN
from pipeline.world.scene_building import add_body, add_table
from pipeline.world.shapes import Collider, Shape

INSTANCES, BUILT = 20, 5
"""Instances drawn, and how many of them are built and put on a table."""

TRIANGLES = 800
FIT = 0.009
"""m that the drawn shape and the collision pieces may differ by along each axis."""

WIDEST = 0.075
"""m between the fingers: what every robot's jaws can open to."""

SLACK = 0.003
"""m by which a grasp's `width` may miss the material."""

AROUND, STEP = 0.01, 0.00025
"""m beyond the pads that are looked at, and how finely."""

AHEAD = (0.0, 0.004, 0.008, 0.012)
"""m in front of the tcp, inside the pads, where a grasp may meet material."""

ROOM, SHALLOW, OFF = 0.015, 0.3, 0.002
"""m before a frame that make a hollow of a family, the share of it that an object has at least, and m between tested points."""

SECONDS = 1.0


def check_object(name: str) -> list[Finding]:
    """Check one object family, on instances of seeds 0, 1, 2 ...; an error of its own code is a finding.

    Raises UnknownName for a family that does not exist.
    """
    return [*catch_errors("family", FAMILIES[name], lambda: _check(name, FAMILIES[name]))]


def _check(name: str, family: type[Family]) -> list[Finding]:
    if stands_for(family):  # one object from files: it is always the same, and has the words that its user gave it
        built = [(one := family.draw(_rng(0)), one.shape())]
        return [_meshes(built, OF_A_FILE), _fit(built), _frames(built), _hollows(built), _grasps(built), _rest(name, built)]
    drawn = [family.draw(_rng(seed)) for seed in range(INSTANCES)]
    built = [(one, one.shape()) for one in drawn[:BUILT]]
    return [
        _drawing(family, drawn),
        _meshes(built, TRIANGLES),
        _fit(built),
        _frames(built),
        _grasps(built),
        _words(drawn),
        _rest(name, built),
    ]


def _rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


def _judge(name: str, problems: Iterator[str] | Sequence[str], good: str) -> Finding:
    """The first problem, or what is good."""
    first = next(iter(problems), None)
    return Finding(name, first is None, first or good)


def _drawing(family: type[Family], drawn: Sequence[Family]) -> Finding:
    def problems() -> Iterator[str]:
        if list(drawn) != [family.draw(_rng(seed)) for seed in range(INSTANCES)]:
            yield "the same seed draws another instance: take every random number from `rng`, and make the class a frozen dataclass"
        different = len(set(drawn))
        if different < INSTANCES:
            yield f"{INSTANCES} seeds draw {different} instances: draw its sizes and colours from `rng`"

    return _judge("drawing", problems(), f"{INSTANCES} seeds draw {INSTANCES} instances, each always the same")


def _meshes(built: Sequence[tuple[Family, Shape]], most: int) -> Finding:
    def problems() -> Iterator[str]:
        for one, shape in built:
            count = sum(len(mesh.triangles) for mesh, _ in shape.visual)
            if count > most:
                yield f"{one}: {count} triangles are drawn: {most} at most, so that frames stay cheap (fewer sides or levels)"
            for mesh, material in shape.visual:
                if not np.isfinite(mesh.vertices).all() or mesh.triangles.max() >= len(mesh.vertices):
                    yield f"{one}: a mesh has vertices that are not finite, or triangles of vertices that it does not have"
                if np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() > 1e-4:
                    yield f"{one}: a mesh has normals that are not of length 1"
                if material.texture is not None and mesh.uvs is None:
                    yield f"{one}: a mesh with a texture has no uvs"

    return _judge("meshes", problems(), f"at most {most} triangles, finite, with unit normals")


def _fit(built: Sequence[tuple[Family, Shape]]) -> Finding:
    def problems() -> Iterator[str]:
        for one, shape in built:
            points = np.concatenate([mesh.vertices for mesh, _ in shape.visual])
            seen, solid = np.stack([points.min(0), points.max(0)]), shape.aabb()
            if abs(seen[0, 2]) > 1e-3 or abs(solid[0, 2]) > 1.5e-3:
                yield f"{one}: its lowest point is at z = {seen[0, 2]:.4f} m drawn, {solid[0, 2]:.4f} m solid: the base is at z = 0"
            apart = np.maximum(solid[0] - seen[0], seen[1] - solid[1]).max()
            if apart > FIT:
                yield f"{one}: what is drawn reaches {1000 * apart:.0f} mm out of its collision pieces: {1000 * FIT:.0f} mm at most"
            if not (0.001 < shape.mass < 12 and 0.2 <= shape.friction <= 1.0):
                yield f"{one}: mass {shape.mass:.4g} kg, friction {shape.friction:g}: 0.001 to 12 kg and 0.2 to 1 are sensible"

    return _judge("shape", problems(), "stands on z = 0; what is drawn and what is solid agree")


def _frames(built: Sequence[tuple[Family, Shape]]) -> Finding:
    def problems() -> Iterator[str]:
        for one, shape in built:
            points, (lower, upper) = one.frames().points, shape.aabb()
            if missing := {"base", "top"} - points.keys():
                yield f"{one}: has no frame {' and no frame '.join(sorted(missing))}: every object has base (the origin) and top"
                continue
            if np.abs(points["base"] - pose((0, 0, 0))).max() > 1e-9:
                yield f"{one}: its frame base is not the origin: mark(0, 0, 0)"
            if abs(points["top"][2] - upper[2]) > FIT:
                yield f"{one}: its frame top is at z = {points['top'][2]:.3f} m, the object ends at {upper[2]:.3f} m"
            for label, p in points.items():
                if abs(np.linalg.norm(p[3:]) - 1) > 1e-9 or np.any((p[:3] < lower - 0.01) | (p[:3] > upper + 0.01)):
                    yield f"{one}: its frame {label} lies more than 1 cm off the object, or its quaternion is not of length 1"

    return _judge("frames", problems(), ", ".join(built[0][0].frames().points))


def _hollows(built: Sequence[tuple[Family, Shape]]) -> Finding:
    """Where the family that an object from files stands for is hollow, the object must be, too."""

    def problems() -> Iterator[str]:
        for one, shape in built:
            family = stands_for(type(one)) or ""
            model = first_of(family)
            theirs, own = model.frames().points, one.frames().points
            for label in theirs.keys() & own.keys() - {"base", "top"}:
                usual, free = (free_before(s, points[label]) for s, points in ((model.shape(), theirs), (shape, own)))
                if usual >= ROOM and free < usual * SHALLOW:
                    yield (
                        f"{one}: {1000 * free:.0f} mm are free before its frame {label}, {1000 * usual:.0f} mm in a {family}: "
                        f"nothing goes in there; use another --family, or correct the frame"
                    )

    return _judge("hollows", problems(), "hollow where its family is")


def free_before(shape: Shape, at: Pose) -> float:
    """The free way (m) from a frame along its normal to the end of the bounding box; 0 if material is in it."""
    lower, upper = shape.aabb()
    normal = quat_rotate(at[3:], np.array([0.0, 0.0, 1.0]))
    steps = np.arange(OFF, float(np.linalg.norm(upper - lower)), OFF)
    points = at[:3] + steps[:, None] * normal
    within = np.all((points > lower) & (points < upper), axis=1)
    return 0.0 if inside(shape.collision, points[within]).any() else OFF * int(within.sum())


def _grasps(built: Sequence[tuple[Family, Shape]]) -> Finding:
    def problems() -> Iterator[str]:
        for one, shape in built[:2]:
            for g in one.frames().grasps:
                if not 0 < g.width <= WIDEST:
                    yield f"{one}: a grasp of kind {g.kind} is {g.width:.3f} m wide: more than 0, and {WIDEST} m at most"
                elif not any(_holds(shape.collision, g, ahead) for ahead in AHEAD):
                    at = ", ".join(f"{x:.3f}" for x in g.pose[:3])
                    yield (
                        f"{one}: a grasp of kind {g.kind} at ({at}) m holds nothing {1000 * g.width:.1f} mm wide: along its "
                        f"opening direction (y) the collision pieces must end {1000 * g.width / 2:.1f} mm to either side of the tcp"
                    )

    kinds = sorted({g.kind for g in built[0][0].frames().grasps})
    count = len(built[0][0].frames().grasps)
    return _judge(
        "grasps", problems(), f"{count}, of kinds {', '.join(kinds)}" if kinds else "none: it can only be pressed or put on"
    )


def _holds(pieces: Sequence[Collider], g: Grasp, ahead: float) -> bool:
    """Whether along the opening direction material ends, within SLACK, at both pads."""
    approach, opening = quat_rotate(g.pose[3:], np.eye(3)[:2])
    offsets = np.arange(-g.width / 2 - AROUND, g.width / 2 + AROUND, STEP)
    points = g.pose[:3] + ahead * approach + offsets[:, None] * opening
    solid = offsets[inside(pieces, points)]
    return len(solid) > 0 and bool(max(abs(solid[0] + g.width / 2), abs(solid[-1] - g.width / 2)) < SLACK)


def _words(drawn: Sequence[Family]) -> Finding:
    def problems() -> Iterator[str]:
        for one in drawn:
            try:
                words = one.words()
            except ValueError as error:
                yield str(error)
                continue
            said = (*words.seen, *words.unseen)
            if (len(words.seen), len(words.unseen)) != (SEEN, UNSEEN) or len(set(said)) < len(said):
                yield f"{one}: {len(words.seen)} seen and {len(words.unseen)} unseen descriptions, {len(set(said))} different ones"
            if words.noun not in words.seen:
                yield f"{one}: its noun {words.noun!r} is not among its seen descriptions: detectors are asked for it"
            if wrong := [p for p in said if p != p.strip() or "{" in p or p.lower().startswith(("a ", "an ", "the "))]:
                yield f"{one}: {wrong[0]!r} begins with an article, or has a slot or spaces left over"

    return _judge("words", problems(), f"{SEEN} seen and {UNSEEN} unseen descriptions")


def _rest(name: str, built: Sequence[tuple[Family, Shape]]) -> Finding:
    def problems() -> Iterator[str]:
        for one, _ in built:
            moved, tilt = _settle(Body(name, name, one, pose((0, 0, TABLE_TOP))))
            if moved > 0.005 or tilt > 2.0:
                yield (
                    f"{one}: put on a table it moves by {1000 * moved:.0f} mm and tilts by {tilt:.0f} degrees in {SECONDS:g} s: "
                    "give it a flat base of collision pieces"
                )

    return _judge("rest", problems(), "rests where it is put")


def _settle(body: Body) -> tuple[float, float]:
    """How far (m) a body put on a table has moved along it after SECONDS, and how far (degrees) its z axis has tilted."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 240)
    add_table(scene)
    entity = add_body(scene, body, body.pose)
    for _ in range(round(240 * SECONDS)):
        scene.step()
    at: Pose = np.concatenate([entity.pose.p, entity.pose.q]).astype(float)
    up = quat_rotate(at[3:], np.array([0.0, 0.0, 1.0]))[2]
    return float(np.linalg.norm(at[:2] - body.pose[:2])), float(np.degrees(np.arccos(np.clip(up, -1, 1))))
