"""The articulation of an arm has the bits that SAPIEN's own loader gives it from the arm as
URDF."""

from dataclasses import replace

import numpy as np
import pytest
import sapien

from pipeline.intake.robots.write import arm_urdf
from pipeline.poses import pose, quat_from_rpy
from pipeline.world.physics.arms import add_arm, arm_builder
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Arm
from pipeline.world.shapes import Collider

TURNED = quat_from_rpy(0.3, -0.5, 1.1)
CYLINDER = Collider("cylinder", (0.02, 0.05), pose((0.01, 0.02, 0.03), TURNED))


def bits(builder: sapien.ArticulationBuilder) -> list[bytes]:
    """Everything of links and joints that reaches PhysX, as float32."""
    found = []
    for link in builder.link_builders:
        joint = link.joint_record
        at = (link._cmass_local_pose, joint.pose_in_parent, joint.pose_in_child)
        numbers = [
            *(part for p in at for part in (p.p, p.q)),
            link._mass,
            link._inertia,
            np.ravel(joint.limits),
            joint.damping,
        ]
        words = [link.name, joint.name, joint.joint_type]
        found.append(
            b"".join(np.asarray(n, np.float32).tobytes() for n in numbers) + repr(words).encode()
        )
    return found


def shape_bits(robot) -> list[list[tuple]]:
    """The mass and the shapes of each link in a scene, as they are in PhysX."""
    return [
        [(link.mass, link.inertia.tobytes(), link.cmass_local_pose.__getstate__())]
        + [
            (
                type(shape).__name__,
                shape.local_pose.__getstate__(),
                [
                    np.asarray(getattr(shape, name, ())).tolist()
                    for name in ("half_size", "radius", "half_length")
                ],
                shape.density,
                shape.physical_material.static_friction,
                shape.physical_material.dynamic_friction,
                shape.physical_material.restitution,
            )
            for shape in link.collision_shapes
        ]
        for link in robot.links
    ]


def by_loader(arm: Arm, path) -> sapien.ArticulationBuilder:
    path.write_text(arm_urdf(arm))
    loader = sapien.Scene([sapien.physx.PhysxCpuSystem()]).create_urdf_loader()
    loader.set_material(1.2, 1.2, 0.0)
    return loader.load_file_as_articulation_builder(str(path))


@pytest.mark.parametrize("name", MODELS)
def test_an_arm_is_what_the_loader_makes_of_its_urdf(name, tmp_path):
    arm = get_embodiment(name).arms["left"]
    first, *others = arm.links
    turned = replace(
        first,
        products=(0.1 * first.inertia[0], 0.0, -0.05 * first.inertia[0]),
        collision=(*first.collision, CYLINDER),
    )
    for one in (arm, replace(arm, links=(turned, *others))):
        loaded = by_loader(one, tmp_path / "arm.urdf")
        assert bits(arm_builder(one)) == bits(loaded)
        loaded.set_scene(sapien.Scene([sapien.physx.PhysxCpuSystem()]))
        scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        built = add_arm(scene, "left", one).robot
        assert shape_bits(built) == shape_bits(loaded.build())
