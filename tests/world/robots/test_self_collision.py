"""The collision pieces of the specs, asked of pinocchio and coal: home is free, and no reviewed
pair is missing or idle."""

from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
import pytest

from pipeline.data.names import SIDES
from pipeline.poses import matrix, pose
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Embodiment, jaw_positions, root_link
from pipeline.world.shapes import Collider
from tests.world.robots.both_arms import embodiment_urdf
from tests.world.robots.limits import arm_limits

TABLE = Collider("box", (0.6, 0.35, 0.025), pose((0, 0, 0.715)))


class Checker:
    """All pieces of both arms, the furniture and the table; `touching` names the link pairs that
    overlap."""

    def __init__(self, e: Embodiment, path) -> None:
        path.write_text(embodiment_urdf(e))
        self.e = e
        self.model = pin.buildModelFromUrdf(str(path))
        self.geometry = pin.buildGeomFromUrdf(self.model, str(path), pin.GeometryType.COLLISION)
        self.owner = [self.model.frames[g.parentFrame].name for g in self.geometry.geometryObjects]
        for i, piece in enumerate([TABLE, *e.furniture_collision]):
            assert piece.kind == "box"
            placement = pin.SE3(matrix(piece.pose))
            self.geometry.addGeometryObject(
                pin.GeometryObject(
                    f"fixed{i}", 0, 0, placement, coal.Box(*(2 * s for s in piece.size))
                )
            )
            self.owner.append("table" if i == 0 else "furniture")
        adjacent = {
            frozenset((f"{s}_{j.parent}", f"{s}_{j.child}"))
            for s in SIDES
            for j in e.arms[s].joints
        }
        fixed = {"table", "furniture"}
        for i, j in combinations(range(len(self.owner)), 2):
            pair = frozenset((self.owner[i], self.owner[j]))
            if len(pair) == 2 and pair not in adjacent and pair != fixed:
                self.geometry.addCollisionPair(pin.CollisionPair(i, j))
        self.data, self.found = self.model.createData(), self.geometry.createData()

    def touching(self, q: dict[str, np.ndarray], value: float) -> set[frozenset[str]]:
        full = np.zeros(self.model.nq)
        for side in SIDES:
            arm = self.e.arms[side]
            values = (*q[side], *jaw_positions(arm.gripper, value))
            for name, x in zip((*arm.arm_joints, *arm.gripper.joints), values, strict=True):
                full[self.model.joints[self.model.getJointId(f"{side}_{name}")].idx_q] = x
        pin.computeCollisions(self.model, self.data, self.geometry, self.found, full, False)
        hits = (k for k, r in enumerate(self.found.collisionResults) if r.isCollision())
        pairs = (self.geometry.collisionPairs[k] for k in hits)
        return {frozenset((self.owner[p.first], self.owner[p.second])) for p in pairs}


def allowed(e: Embodiment) -> set[frozenset[str]]:
    return {
        frozenset((f"{s}_{a}", f"{s}_{b}")) for s in SIDES for a, b in e.arms[s].allowed_overlap
    }


@pytest.mark.parametrize("name", (*MODELS, "aloha+ur5", "piper+franka"))
def test_home_is_free_and_rest_overlaps_are_reviewed(name, tmp_path):
    e = get_embodiment(name)
    checker = Checker(e, tmp_path / "robot.urdf")
    home = {side: np.array(e.arms[side].home) for side in SIDES}
    for value in (0.0, 0.5, 1.0):
        assert checker.touching(home, value) <= allowed(e)


@pytest.mark.parametrize("name", MODELS)
def test_no_pair_collides_in_most_configurations(name, tmp_path):
    e = get_embodiment(name)
    checker = Checker(e, tmp_path / "robot.urdf")
    rng = np.random.default_rng(3)
    counts: dict[frozenset[str], int] = {}
    for _ in range(150):
        q = {side: rng.uniform(*arm_limits(e.arms[side]).T) for side in SIDES}
        for pair in checker.touching(q, 0.5) - allowed(e):
            counts[pair] = counts.get(pair, 0) + 1
    roots = {f"{side}_{root_link(e.arms[side])}" for side in SIDES}
    assert max(counts.values()) < 0.7 * 150, counts
    # bases rest on their stands without overlap, at any configuration
    assert not any(pair & roots and "furniture" in pair for pair in counts)
