"""The film of an episode."""

import io

import av
import numpy as np

from pipeline.data.episode.file import open_episode
from pipeline.report.film_strip import clip
from tests.synthetic import make_episode


def test_the_film_has_every_frame_of_every_camera_side_by_side(tmp_path):
    path = make_episode(tmp_path / "e.hdf5", frames=7)
    with open_episode(path) as e, av.open(io.BytesIO(clip(path, 64))) as film:
        images = [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]
        assert len(images) == len(e) == 7 and film.streams.video[0].average_rate == e.fps
        first = e.rgb(e.cameras[0], 6)
        width = images[0].shape[1] // len(e.cameras)
        assert (
            images[0].shape == (64, width * len(e.cameras), 3)
            and abs(width - first.shape[1] * 64 / first.shape[0]) <= 1
        )
        # each camera's mean colour stands where the camera stands
        for i, camera in enumerate(e.cameras):
            shown = images[6][:, i * width : (i + 1) * width].mean((0, 1))
            assert np.abs(shown - e.rgb(camera, 6).mean((0, 1))).max() < 8
    assert clip(path, 64) == clip(path, 64)
    assert clip(path, 1000) == clip(path, first.shape[0])
