"""Textures and light that a user brings: found, refused, and turned into looks."""

import os
import zlib

import cv2
import numpy as np
import pytest

from pipeline.data.setup import RecipeError, Setup
from pipeline.data.setup.brought import (
    BroughtError,
    bring_light,
    bring_textures,
    hash_light,
    hash_textures,
    light_of,
    read_unchanged,
    textures_of,
)
from pipeline.data.spec import EpisodeSpec
from pipeline.stages.drawing.render import surface_images, visuals_of
from pipeline.world.looks.visuals import BRIGHTNESS, CLEAN


def image(path, rgb):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((8, 16, 3), rgb[::-1], np.uint8))


def sky(path, sun=(8, 40)):
    """Radiance of 1 all around and 2000 in one pixel (row, column) of 32x64."""
    radiance = np.ones((32, 64, 3), np.float32)
    radiance[sun] = 2000
    cv2.imwrite(str(path), radiance)
    return path


def test_textures_of_a_directory_are_the_looks_of_an_episode(tmp_path):
    image(tmp_path / "table" / "oak@0.8.png", (200, 100, 50))
    image(tmp_path / "table" / "stone.png", (90, 90, 90))
    image(tmp_path / "wall" / "brick.png", (10, 200, 30))
    (tmp_path / "LICENSE.txt").write_text("\nCC0 1.0\n")
    brought = bring_textures(str(tmp_path))
    setup = Setup.parse({"textures": str(tmp_path)})
    assert setup.textures == brought and brought.licence == "CC0 1.0"
    assert Setup.parse(setup.given()) == setup
    assert [metres for _, metres in textures_of(brought)["table"]] == [0.8, 0.6]
    drawn = [
        visuals_of(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", slot, 0), setup)
        for slot in range(12)
    ]
    assert {v.table.seed for v in drawn} == {0, 1} and {v.table.tile for v in drawn} == {0.8, 0.6}
    first = next(v for v in drawn if v.table.seed == 0)
    assert np.allclose(np.multiply(first.table.color, 255), (200, 100, 50), atol=1)
    assert first.ground == CLEAN.ground and first.sun == CLEAN.sun
    images = surface_images(first, setup)
    assert set(images) == {"table", "wall"} and (images["wall"][0, 0] == (10, 200, 30, 255)).all()
    image(tmp_path / "wall" / "brick.png", (11, 200, 30))
    assert bring_textures(str(tmp_path)).content != brought.content
    read_unchanged.cache_clear()
    with pytest.raises(BroughtError, match="has changed"):
        textures_of(brought)


def test_light_has_the_direction_and_the_share_of_the_sun(tmp_path):
    environment = bring_light(str(sky(tmp_path / "sky.hdr")))
    setup = Setup(environment=environment)
    visuals = visuals_of(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 0), setup)
    polar, around = 8.5 / 32 * np.pi, (40.5 / 64 - 0.5) * 2 * np.pi
    toward = np.array(
        [np.sin(polar) * np.sin(around), np.sin(polar) * np.cos(around), np.cos(polar)]
    )
    # the brightest hundredth of the sphere has the sky around the sun, too
    assert -np.array(visuals.sun_direction) @ toward > 0.99
    assert visuals.points == ()
    sun, ambient = np.array(visuals.sun), np.array(visuals.ambient)
    assert sun - sun[0] == pytest.approx(0, abs=1e-3)
    assert (ambient - sun * visuals.sun_direction[2]).mean() == pytest.approx(BRIGHTNESS, abs=1e-5)
    # a sky of 1 gives the table pi; the sun's pixel gives radiance times solid angle, and the table
    # its cosine of that
    direct = 2000 * np.sin(polar) * (np.pi / 32) ** 2 / np.pi
    assert sun[0] / ambient[0] == pytest.approx(direct, rel=0.1)
    assert light_of(environment).shape == (32, 64, 3)


def test_what_is_missing_or_damaged_is_named_in_one_line(tmp_path):
    image(tmp_path / "odd" / "table" / "oak@wide.png", (1, 2, 3))
    image(tmp_path / "cut" / "table" / "oak.png", (1, 2, 3))
    whole = (tmp_path / "cut" / "table" / "oak.png").read_bytes()
    (tmp_path / "cut" / "table" / "oak.png").write_bytes(whole[:20])
    (tmp_path / "empty" / "table").mkdir(parents=True)
    cut = sky(tmp_path / "cut.hdr")
    cut.write_bytes(b"#?RADIANCE\n")
    cv2.imwrite(str(tmp_path / "square.hdr"), np.ones((8, 8, 3), np.float32))
    refused = {
        "nowhere": "no directory of textures",
        "empty": "no directory of textures",
        "cut": "oak.png",
        "odd": "0.01 to 100",
        "nowhere.hdr": "cannot be read",
        "cut.hdr": "no light",
        "square.hdr": "twice as wide",
        "sky.exr": ".hdr",
    }
    for name, said in refused.items():
        with pytest.raises(BroughtError, match=said) as error:
            (hash_light if "." in name else hash_textures)(tmp_path / name)
        assert "\n" not in str(error.value)


def test_images_that_unpack_to_gigabytes_and_pipes_end_in_one_line(tmp_path):
    (tmp_path / "table").mkdir()
    (tmp_path / "table" / "bomb.png").write_bytes(png_of(20_000, zlib.compress(bytes(1 << 20))))
    (tmp_path / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n" + bytes(1000)
    )
    for key, given in (("textures", tmp_path), ("environment", tmp_path / "sky.hdr")):
        with pytest.raises(RecipeError, match=f"{key}.*make it smaller") as error:
            Setup.parse({key: str(given)})
        assert "\n" not in str(error.value)
    (tmp_path / "table" / "bomb.png").unlink()
    os.mkfifo(tmp_path / "table" / "pipe.png")
    with pytest.raises(BroughtError, match="is no regular file"):
        hash_textures(tmp_path)


def png_of(side: int, packed: bytes) -> bytes:
    """A PNG of side x side RGB pixels whose rows are packed."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        )

    head = side.to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )
