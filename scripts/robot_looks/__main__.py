"""Draws the looks of the five robots into `pipeline/assets/robots/*/meshes`, from the vendors'
proportions.

python -m scripts.robot_looks            # write the files
python -m scripts.robot_looks --check    # exit code 1 where a file is not what the script draws
"""

import sys

from pipeline.data.atomic import write_atomic
from pipeline.intake.robots.write import mesh_file
from pipeline.world.files import write_glb
from pipeline.world.robots import MODELS
from pipeline.world.robots.contract import Arm
from pipeline.world.robots.directory import HEAD_CAMERA
from pipeline.world.shapes import Material, Parts
from scripts.robot_looks.arx_look import ColorScheme, arx_visuals
from scripts.robot_looks.franka_look import panda_visuals
from scripts.robot_looks.kit import (
    BLACK,
    CHARCOAL,
    GREY,
    RUBBER,
    SILVER,
    WHITE,
    block,
    depth_camera,
    housing,
    painted,
)
from scripts.robot_looks.piper_look import piper_visuals
from scripts.robot_looks.ur5_look import ur5_visuals

RED = Material((0.75, 0.08, 0.07), 0.5)
SCHEMES = {"aloha-agilex": ColorScheme(), "arx-x5": ColorScheme(BLACK, WHITE, RED, SILVER)}
FINGER_TIP = 0.018  # m, beyond the tool frame


def looks(name: str, arm: Arm) -> dict[str, Parts]:
    """What the links of a robot look like, by name."""
    camera = arm.camera.pose
    if name in SCHEMES:
        hinges, jaws = arm.joints[:6], arm.joints[6:]
        origins = [(x, y, z) for x, y, z in (j.origin[:3].tolist() for j in hinges)]
        (ax, ay, az), (bx, by, bz) = (j.origin[:3].tolist() for j in jaws)
        end = round(float(arm.tcp[0]) + FINGER_TIP, 6)
        return dict(arx_visuals(origins, ((ax, ay, az), (bx, by, bz)), end, camera, SCHEMES[name]))
    draw = {"franka-panda": panda_visuals, "piper": piper_visuals, "ur5-wsg": ur5_visuals}
    return dict(draw[name](camera))


def wheeled_base() -> Parts:
    """Wheeled base, cabinet, frame under the arms and camera mast of aloha-agilex in the world
    frame, all behind the table edge."""
    rails = [
        block((s * 0.3 - 0.02, -0.76, 0.2), (s * 0.3 + 0.02, -0.72, 0.745), 0.003) for s in (-1, 1)
    ]
    rails += [
        block((s * 0.3 - 0.02, -0.42, 0.2), (s * 0.3 + 0.02, -0.38, 0.745), 0.003) for s in (-1, 1)
    ]
    rails += [block((-0.36, y - 0.02, 0.72), (0.36, y + 0.02, 0.76), 0.003) for y in (-0.74, -0.4)]
    mast = [
        block((-0.02, -0.66, 0.76), (0.02, -0.62, 1.385), 0.003),
        block((-0.02, -0.64, 1.36), (0.02, -0.478, 1.385), 0.003),
    ]
    wheels = [
        housing((s * 0.295, y, 0.085), (s * 0.245, y, 0.085), 0.085, 0.01)
        for s in (-1, 1)
        for y in (-0.86, -0.5)
    ]
    plates = [
        block((s * 0.3 - 0.07, -0.485, 0.768), (s * 0.3 + 0.07, -0.357, 0.781), 0.004)
        for s in (-1, 1)
    ]
    visual = painted(
        (
            BLACK,
            [
                block((-0.24, -0.99, 0.09), (0.24, -0.37, 0.2), 0.02),
                block((-0.2, -0.9, 0.2), (0.2, -0.46, 0.66), 0.01),
            ],
        ),
        (SILVER, [*rails, *mast]),
        (CHARCOAL, [*plates, block((-0.37, -0.77, 0.755), (0.37, -0.365, 0.77), 0.003)]),
        (RUBBER, wheels),
        (GREY, [block((-0.18, -0.462, 0.45), (0.18, -0.456, 0.6))]),
    )
    return (*visual, *depth_camera(HEAD_CAMERA))


def main() -> int:
    stale = []
    for name, model in MODELS.items():
        files = {
            mesh_file(link): write_glb(parts)
            for link, parts in looks(name, model.arm("left")).items()
        }
        if model.settings.body is not None:
            files[model.settings.body.mesh] = write_glb(wheeled_base())
        for file, data in files.items():
            path = model.directory / file
            if not path.is_file() or path.read_bytes() != data:
                stale.append(path)
                if "--check" not in sys.argv:
                    write_atomic(path, data)
    print(
        f"{len(stale)} files differ from what is drawn"
        if "--check" in sys.argv
        else f"wrote {len(stale)} files"
    )
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
