import io

import av
import numpy as np
import pytest

from pipeline.data.episode.frames import encode_mp4


@pytest.mark.parametrize("size", [(64, 258), (96, 96), (52, 36)], ids=str)
def test_the_same_frames_give_the_same_bytes_whatever_the_memory_held_before(size):
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (*size, 3), np.uint8) for _ in range(7)]
    held, films = [], set()
    for _ in range(40):
        # so that buffers come from memory that was written to
        held = [*held[-20:], rng.bytes(int(rng.integers(1000, 400000)))]
        films.add(encode_mp4(iter(frames), 30))
    assert len(films) == 1


def test_frames_come_back_in_order_and_near_what_they_were():
    frames = [np.full((48, 64, 3), 30 * i, np.uint8) for i in range(8)]
    with av.open(io.BytesIO(encode_mp4(iter(frames), 20))) as film:
        images = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert [round(float(image.mean()) / 30) for image in images] == list(range(8))


def test_no_frames_are_no_film():
    assert encode_mp4(iter(()), 30) == b""
