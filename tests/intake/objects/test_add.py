"""Objects from files: how they stand, what they weigh, where they are held, what is drawn of
them."""

import io
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.data.errors import DominoError
from pipeline.intake.catalogue.object_check import check_object, free_before
from pipeline.intake.objects.add import describe, draft_all, enter_objects
from pipeline.intake.objects.draft import draft_of
from pipeline.intake.objects.holding import two_finger_grasps
from pipeline.intake.objects.standing import instance_of
from pipeline.plugins import load_plugins
from pipeline.poses import quat_rotate
from pipeline.world.files import read_glb, write_glb
from pipeline.world.meshes.reader import read_mesh
from pipeline.world.objects.contract import FAMILIES, stands_for
from pipeline.world.objects.from_files import ObjectError, add_all, piece
from tests.intake.objects.conftest import add_here
from tests.intake.objects.meshes import (
    box_file,
    gltf,
    robotwin_directory,
    textured_box,
    textured_obj,
)


def test_a_box_stands_on_its_base_weighs_what_it_should_and_is_held_across(tmp_path, options):
    added = add_here(box_file(tmp_path / "box.obj"), replace(options, density=1000.0, up="z"))
    one = FAMILIES["thing"].draw(np.random.default_rng())
    lower, upper = one.shape().aabb()
    assert lower[2] == pytest.approx(0, abs=1e-6) and upper[2] == pytest.approx(0.09, abs=1e-5)
    assert sorted(upper[:2] - lower[:2]) == pytest.approx([0.04, 0.05], abs=1e-5)
    assert one.shape().mass == pytest.approx(0.18, abs=1e-3)
    grasps = one.frames().grasps
    edges = upper[:2] - lower[:2]
    for g in grasps:  # across two sides, as far as friction holds, never the hand below the table
        opening = quat_rotate(g.pose[3:], [0.0, 1.0, 0.0])
        across = int(np.argmax(np.abs(opening)))
        assert opening[2] == pytest.approx(0, abs=1e-6) and np.abs(opening[across]) > np.cos(
            np.radians(28)
        )
        assert (
            g.width == pytest.approx(edges[across] / np.abs(opening[across]), abs=1e-4)
            and g.pose[2] > 0
        )
    assert {int(np.argmax(np.abs(quat_rotate(g.pose[3:], [0.0, 1.0, 0.0])))) for g in grasps} == {
        0,
        1,
    }
    assert [f for f in check_object("thing") if not f.ok] == []
    assert stands_for(FAMILIES["thing"]) == "tea_box" and "5.0 x 4.0 x 9.0" in next(
        describe(added)
    ).replace("4.0 x 5.0", "5.0 x 4.0")


def test_the_same_mesh_gives_the_same_bytes_and_a_directory_is_read_again(tmp_path, options):
    file = box_file(tmp_path / "box.stl")
    options = replace(options, words=("thing",))
    first = add_here(file, options).directory
    second = add_here(file, replace(options, name="twin")).directory
    for path in first.iterdir():
        assert path.read_bytes() == (second / path.name).read_bytes()
    FAMILIES.remove("thing")
    add_all(first.parent)
    assert FAMILIES["thing"].draw(np.random.default_rng()).words().noun == "thing"


def test_without_up_an_object_stands_as_its_family_does(tmp_path, options):
    trimesh.creation.cylinder(radius=0.027, height=0.18).export(tmp_path / "bottle.obj")
    heights = []
    for family in ("bottle", "lying_bottle"):
        solid = draft_of(tmp_path / "bottle.obj", replace(options, family=family)).solid
        heights.append(max(float(one.support_points()[:, 2].max()) for one in solid))
    assert heights[0] == pytest.approx(0.18, abs=2e-3) and heights[1] == pytest.approx(
        0.054, abs=2e-3
    )


def test_a_texture_is_kept_and_comes_back_from_the_glb(tmp_path, options):
    looks = draft_of(textured_box(tmp_path / "box.glb"), replace(options, up="y")).looks
    (tmp_path / "looks.glb").write_bytes(data := write_glb(looks))
    [(mesh, material)] = read_glb(tmp_path / "looks.glb")
    assert material.texture is not None and mesh.uvs is not None
    high, low = mesh.vertices[:, 2] > 0.08, mesh.vertices[:, 2] < 0.01  # red above
    rows = np.clip((mesh.uvs[:, 1] * 8).astype(int), 0, 7)
    assert (material.texture[rows[high], 0, 0] == 255).all() and (
        material.texture[rows[low], 0, 2] == 255
    ).all()
    assert write_glb(read_glb(tmp_path / "looks.glb")) == data
    seen = trimesh.load_scene(io.BytesIO(data), file_type="glb").dump()[0]
    assert seen.visual.material.baseColorTexture.size == (8, 8)


def test_a_directory_of_robotwin_gives_an_object_for_every_instance(tmp_path, options):
    directory = robotwin_directory(tmp_path / "039_box")
    made = enter_objects(draft_all(directory, options), options.to)
    assert [one.directory.name for one in made] == ["thing_0", "thing_1"]
    frames = FAMILIES["thing_1"].draw(np.random.default_rng()).frames()
    [grasp] = frames.grasps
    assert grasp.width == pytest.approx(0.04, abs=1e-5)
    assert grasp.pose[2] == pytest.approx(0.045, abs=1e-5)
    assert frames["functional_0"][2] == pytest.approx(0.09, abs=1e-5)
    assert quat_rotate(frames["functional_0"][3:], [0.0, 0.0, 1.0])[2] == pytest.approx(1, abs=1e-5)
    with pytest.raises(ObjectError, match="exists"):
        enter_objects(draft_all(directory, options), options.to)


def test_a_solid_box_is_no_mug(tmp_path, options):
    add_here(box_file(tmp_path / "box.obj", (0.07, 0.06, 0.08)), replace(options, family="mug"))
    [found] = [found for found in check_object("thing") if found.name == "hollows"]
    assert not found.ok and "mm are free before its frame" in found.detail
    mug = instance_of("mug")
    bottom, edge = mug.frames()["inside"][2], mug.shape().aabb()[1, 2]
    assert free_before(mug.shape(), mug.frames()["inside"]) == pytest.approx(
        edge - bottom, abs=0.004
    )


def test_an_object_may_stand_for_a_family_of_plugins(tmp_path, options, monkeypatch):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "sponges.py").write_text(
        "from pipeline.world.objects import FAMILIES\nfrom pipeline.world.objects.contract import"
        " register\n@register('sponge')\nclass Sponge(FAMILIES['soap']): pass\n"
    )
    monkeypatch.setenv("DOMINO_PLUGINS", str(mine))
    monkeypatch.syspath_prepend(mine)
    load_plugins()
    file, wanted = (
        box_file(tmp_path / "box.obj", (0.07, 0.05, 0.03)),
        replace(options, family="sponge"),
    )
    add_here(file, replace(wanted, to=mine))
    for name in ("thing", "sponge"):
        FAMILIES.remove(name)
    monkeypatch.delitem(sys.modules, "sponges")
    load_plugins()
    assert stands_for(FAMILIES["thing"]) == "sponge"


NODES = {"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}
MANY = {
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 30_000_000, "type": "VEC3"}]
}
AWAY = {"buffers": [{"byteLength": 36, "uri": "../../secret.bin"}]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (NODES, "circle"),
        (MANY, "simplify it first"),
        (AWAY, "outside of"),
        ({"buffers": [{"byteLength": 36, "uri": "/etc/passwd"}]}, "absolute path"),
        (
            {"accessors": [{"bufferView": 7, "componentType": 5126, "count": 3, "type": "VEC3"}]},
            "not readable",
        ),
        ({"meshes": []}, "box.glb"),
        ({"nodes": 7}, "not readable"),
        ({}, "flat"),
    ],
)
def test_a_hostile_glb_is_refused_in_one_line(tmp_path, options, changes, said):
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    (tmp_path / "in").mkdir()
    with pytest.raises(DominoError, match=said) as error:
        add_here(gltf(tmp_path / "in" / "box.glb", **changes), options)
    assert "\n" not in str(error.value) and not options.to.exists()


def test_other_bad_meshes_are_refused_in_one_line(tmp_path, options):
    good = box_file(tmp_path / "good.obj")
    text = good.read_text()
    (tmp_path / "nan.obj").write_text(text.replace("v ", "v nan nan nan\nv ", 1))
    textured_obj(tmp_path / "texture.obj", "newmtl a\nmap_Kd ../../../etc/hostname.png\n")
    (tmp_path / "empty.stl").write_bytes(b"")
    (tmp_path / "packed.zip").write_bytes(b"PK")
    for name, given, said in (
        ("nan.obj", options, "not finite"),
        ("texture.obj", options, "outside of"),
        ("empty.stl", options, "empty.stl"),
        ("packed.zip", options, "convert it"),
        ("missing.glb", options, "missing.glb"),
        ("good.obj", replace(options, mass=0.0), "--mass 0"),
        ("good.obj", replace(options, scale=100.0), "try --scale 0.01"),
        ("good.obj", replace(options, family="ghost"), "no such family"),
        ("good.obj", replace(options, name="../up"), "is no name"),
        ("good.obj", replace(options, name="mug"), "exists"),
    ):
        with pytest.raises(DominoError, match=said) as error:
            add_here(tmp_path / name, given)
        assert "\n" not in str(error.value) and not options.to.exists(), name


def test_a_texture_that_unpacks_to_gigabytes_is_not_unpacked(tmp_path):
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        )

    head = (12_000).to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    bomb = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(bytes(1000)))
        + chunk(b"IEND", b"")
    )
    (tmp_path / "bomb.png").write_bytes(bomb)
    textured_obj(tmp_path / "box.obj", "newmtl a\nmap_Kd bomb.png\n")
    with pytest.raises(DominoError, match="too many pixels"):
        read_mesh(tmp_path / "box.obj")


def test_what_is_wider_than_a_hand_is_held_by_its_wall():
    wall, half = 0.004, 0.05
    sides = [(x, y, 0.04) for x, y in ((half, 0), (-half, 0), (0, half), (0, -half))]
    thick = [
        (wall / 2, half, 0.04),
        (wall / 2, half, 0.04),
        (half, wall / 2, 0.04),
        (half, wall / 2, 0.04),
    ]
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    floor = piece(corners * [half, half, 0.002] + [0, 0, 0.002])
    open_box = [*(piece(corners * h + at) for at, h in zip(sides, thick, strict=True)), floor]
    grasps = two_finger_grasps(open_box)
    assert len(grasps) > 20 and all(g.width < 0.006 for g in grasps)
    for g in grasps:  # from above, one finger in the box
        assert quat_rotate(g.pose[3:], [1.0, 0.0, 0.0])[2] < -0.2 and np.max(
            np.abs(g.pose[:2])
        ) == pytest.approx(half, abs=0.003)
    assert not two_finger_grasps(open_box[4:]) and not two_finger_grasps(
        [piece(corners * 0.05 + [0, 0, 0.05])]
    )
