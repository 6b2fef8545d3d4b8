"""Portraits and the gallery page."""

import base64
import re

import cv2
import numpy as np

from pipeline.intake.catalogue.gallery import portrait, write_gallery
from pipeline.world.looks.materials import PALETTE
from pipeline.world.objects import FAMILIES
from pipeline.world.objects.families.toys.blocks import Block


def test_a_portrait_shows_the_object_in_its_colour():
    image = portrait(Block(0.05, 0.002, "painted", "blue"), size=(96, 72)).astype(float)
    middle = image[30:42, 42:54].reshape(-1, 3).mean(0)
    assert np.argmax(middle) == 2
    assert middle[2] > 2 * middle[0]
    assert PALETTE["blue"][2] > PALETTE["blue"][0]
    corner = image[:8, :8].reshape(-1, 3).mean(0)
    assert np.linalg.norm(corner - middle) > 40


def test_marks_change_the_picture():
    block = Block(0.05, 0.002, "painted", "blue")
    assert (
        np.abs(portrait(block, size=(96, 72)).astype(int) - portrait(block, True, (96, 72))).max()
        > 60
    )


def test_the_page_is_self_contained(tmp_path):
    page = tmp_path / "not" / "there" / "objects.html"
    write_gallery(page, ["mug", "bell"], per_family=2, size=(64, 48))
    text = page.read_text()
    images = re.findall(r'<img src="data:image/jpeg;base64,([^"]+)">', text)
    assert len(images) == 2 * 2 * 2
    assert text.count("<img") == len(images)
    assert "http" not in text
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(images[0]), np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape == (48, 64, 3)  # pyright: ignore[reportOptionalMemberAccess]
    words = FAMILIES["mug"].draw(np.random.Generator(np.random.Philox(0))).words()
    assert words.seen[-1] in text
