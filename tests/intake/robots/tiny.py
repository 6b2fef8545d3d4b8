"""Small URDFs of arms made of boxes, as text: what the tests give to `robots add`."""

from dataclasses import dataclass
from pathlib import Path

SLIDES = """
  <joint name="jaw_a" type="prismatic"><parent link="hand"/><child link="finger_a"/><origin xyz="0 0.01 0.08"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.03" velocity="0.2" effort="40"/></joint>
  <joint name="jaw_b" type="prismatic"><parent link="hand"/><child link="finger_b"/><origin xyz="0 -0.01 0.08"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.03" velocity="0.2" effort="40"/></joint>
"""  # noqa: E501
COUPLED = SLIDES.replace(
    '<axis xyz="0 -1 0"/><limit lower="0" upper="0.03"',
    '<axis xyz="0 1 0"/><mimic joint="jaw_a" multiplier="-1"/><limit lower="-0.03" upper="0"',
)
"""The same fingers, the second of which follows the first with the opposite sign."""

HINGE = """
  <joint name="jaw_a" type="revolute"><parent link="hand"/><child link="finger_a"/><origin xyz="0 0.01 0.06"/>
    <axis xyz="-1 0 0"/><limit lower="0" upper="0.8" velocity="2" effort="5"/></joint>
  <joint name="jaw_b" type="fixed"><parent link="hand"/><child link="finger_b"/><origin xyz="0 -0.01 0.06"/></joint>
"""  # noqa: E501
"""One finger on a hinge, the other one part of the hand: it opens by swinging away."""

_KNUCKLE = """
  <link name="knuckle_{s}"><collision><geometry><box size="0.01 0.01 0.01"/></geometry></collision></link>
  <joint name="knuckle_{s}" type="revolute"><parent link="hand"/><child link="knuckle_{s}"/><origin xyz="0 {y} 0.05"/>
    <axis xyz="{x} 0 0"/>{follow}<limit lower="0" upper="0.5" velocity="2" effort="10"/></joint>
  <joint name="jaw_{s}" type="revolute"><parent link="knuckle_{s}"/><child link="finger_{s}"/><origin xyz="0 0 0.05"/>
    <axis xyz="{x} 0 0"/><mimic joint="knuckle_a" multiplier="-1"/><limit lower="-1" upper="1" velocity="2" effort="10"/></joint>
"""  # noqa: E501
LINKAGE = _KNUCKLE.format(s="a", y=0.02, x=-1, follow="") + _KNUCKLE.format(
    s="b", y=-0.02, x=1, follow='<mimic joint="knuckle_a"/>'
)
"""Two parallelograms: knuckles of 50 mm at y = 20 mm and -20 mm that swing outwards by 0.5 rad, and
fingers that stay parallel."""


@dataclass(frozen=True)
class Tiny:
    """An arm of five joints; its two fingers end 140 mm from the hand's frame and leave 10 to 70 mm
    between them with SLIDES.

    `mesh` names the file of the upper arm's shape, `extra` is added to the URDF.
    """

    jaws: str = SLIDES
    mesh: str | None = None
    extra: str = ""

    def text(self) -> str:
        """The URDF."""
        upper = (
            f'<mesh filename="{self.mesh}"/>'
            if self.mesh is not None
            else '<box size="0.05 0.05 0.22"/>'
        )
        links = [
            _link("base", '<box size="0.1 0.1 0.06"/>', 0.03, 2.0),
            _link("turret", '<box size="0.06 0.06 0.06"/>', 0.05, 0.5),
            _link("upper", upper, 0.15, 0.8),
            _link("lower", '<box size="0.05 0.05 0.2"/>', 0.14, 0.6),
            _link("wrist", '<box size="0.03 0.03 0.03"/>', 0.02, 0.2),
            _link("hand", '<box size="0.04 0.09 0.03"/>', 0.05, 0.3),
            _link("finger_a", '<box size="0.02 0.01 0.06"/>', 0.03, 0.05),
            _link("finger_b", '<box size="0.02 0.01 0.06"/>', 0.03, 0.05),
        ]
        joints = [
            _hinge("j1", "base", "turret", 0.06, "0 0 1", 3.0),
            _hinge("j2", "turret", "upper", 0.06, "0 1 0", 2.0),
            _hinge("j3", "upper", "lower", 0.3, "0 1 0", 2.6),
            _hinge("j4", "lower", "wrist", 0.28, "0 1 0", 2.2),
            _hinge("j5", "wrist", "hand", 0.05, "0 0 1", 3.0),
        ]
        return (
            f'<robot name="tiny">{"".join(links)}{"".join(joints)}{self.jaws}{self.extra}</robot>\n'
        )

    def write(self, folder: Path) -> Path:
        """The URDF in a folder, which is made."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "tiny.urdf"
        path.write_text(self.text())
        return path


def _link(name: str, shape: str, up: float, mass: float) -> str:
    shaped = f'<origin xyz="0 0 {up}"/><geometry>{shape}</geometry>'
    inertia = '<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0 0 {up}"/><mass value="{mass}"/>{inertia}</inertial>'
    return (
        "<link"
        f' name="{name}">{inertial}<visual>{shaped}</visual><collision>{shaped}</collision></link>'
    )


def _hinge(name: str, parent: str, child: str, up: float, axis: str, limit: float) -> str:
    ends = (
        f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {up}"/><axis'
        f' xyz="{axis}"/>'
    )
    return (
        f'<joint name="{name}" type="revolute">{ends}<limit lower="-{limit}" upper="{limit}"'
        ' velocity="3" effort="60"/></joint>'
    )
