"""Videos: one picture a frame, at its time, in its colour, the same bytes every time."""

import io
from itertools import chain

import cv2
import numpy as np
import pytest

from pipeline.data.episode.frames import EpisodeError, decode_frame, encode_frames
from pipeline.export.formats.lerobot.videos import VideoFile
from pipeline.export.shared.episodes import ExportError
from pipeline.export.shared.statistics import TOGETHER, PlaneCounts, color_counts
from pipeline.export.shared.video import Codec, decoded_planes, encode, frames_of

FPS = 15
CODECS = {
    "default": Codec(),
    "av1": Codec("libsvtav1"),
    "h264": Codec("h264", crf=23, preset="veryfast"),
}


def clip(frames: int, seed: int) -> list[np.ndarray]:
    """A grey level per frame on the left, red and blue on the right: every frame differs from its
    neighbours."""
    out = np.zeros((frames, 64, 96, 3), np.uint8)
    out[:, :, :48] = (40 + 20 * np.random.default_rng(seed).permutation(frames) % 200)[
        :, None, None, None
    ]
    out[:, :32, 48:], out[:, 32:, 48:] = (220, 30, 30), (30, 50, 220)
    return list(out)


@pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)
def test_episodes_in_one_file_keep_count_time_and_colour(tmp_path, codec):
    clips = [clip(n, n) for n in (5, 8, 1)]
    video = VideoFile(tmp_path / "chunk" / "file.mp4", FPS)
    spans = [video.append(encode(c, FPS, codec), len(c)) for c in clips]
    video.close()
    assert spans == [(0.0, 5 / 15), (5 / 15, 13 / 15), (13 / 15, 14 / 15)]
    got = list(frames_of(video.path))
    np.testing.assert_allclose([t for t, _ in got], np.arange(14) / FPS, atol=1e-6)
    for (_, picture), source in zip(got, chain(*clips), strict=True):
        assert np.abs(picture.astype(int) - source).mean() < 6
        assert np.abs(picture[8:24, 60:90].reshape(-1, 3).mean(0) - (220, 30, 30)).max() < 20
        assert np.abs(picture[40:56, 60:90].reshape(-1, 3).mean(0) - (30, 50, 220)).max() < 20


@pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)
def test_same_frames_same_bytes(codec):
    assert encode(clip(6, 1), FPS, codec) == encode(clip(6, 1), FPS, codec)


@pytest.mark.parametrize(
    ("preset", "size"), [("faster", (64, 258)), ("fast", (52, 36)), ("slower", (52, 36))]
)
def test_frames_predicted_from_others_give_the_same_bytes_whatever_the_memory_held_before(
    preset, size
):
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (*size, 3), np.uint8) for _ in range(7)]
    held, videos = [], set()
    for _ in range(25):
        # so that buffers come from memory that was written to
        held = [*held[-20:], rng.bytes(int(rng.integers(1000, 400000)))]
        videos.add(encode(iter(frames), FPS, Codec("h264", gop=15, preset=preset)))
    assert len(videos) == 1


def test_only_videos_with_predicted_frames_quantise_plainly():
    assert (
        "x264-params" not in Codec().options()
        and "x264-params" not in Codec("h264", preset="veryfast").options()
    )
    assert Codec("h264", gop=2).options()["x264-params"] == "aq-mode=0:mbtree=0"


def test_every_episode_starts_with_a_key_frame_even_with_gaps_between_them(tmp_path):
    import av

    video = VideoFile(tmp_path / "file.mp4", FPS)
    for n in (3, 3, 2):  # odd lengths: a key frame every second frame would miss the starts
        video.append(encode(clip(n, n), FPS, Codec(gop=2)), n)
    video.close()
    with av.open(str(video.path)) as container:
        keys = [p.is_keyframe for p in container.demux(video=0) if p.dts is not None]
    assert keys[0] and keys[3] and keys[6]


def test_slow_motion_is_not_drawn_late():
    frames = [np.full((240, 320, 3), (120, 125, 130), np.uint8) for _ in range(6)]
    for t, frame in enumerate(frames):
        frame[80 + 2 * t : 120 + 2 * t, 80 + 3 * t : 120 + 3 * t] = (30, 200, 40)
    got = [picture for _, picture in frames_of(io.BytesIO(encode(frames, FPS, Codec())))]
    for t in range(1, 6):
        moved = (frames[t] != frames[t - 1]).any(-1)
        to_own, to_previous = (
            np.abs(got[t].astype(int) - f)[moved].mean() for f in (frames[t], frames[t - 1])
        )
        assert to_own < to_previous / 3


def test_a_lost_frame_is_noticed(tmp_path):
    with pytest.raises(ExportError, match="4 images for 5 frames"):
        VideoFile(tmp_path / "file.mp4", FPS).append(encode(clip(4, 0), FPS, Codec()), 5)


def test_frames_of_reads_from_memory_too():
    assert len(list(frames_of(io.BytesIO(encode(clip(3, 0), FPS, Codec()))))) == 3


def test_planes_of_a_jpeg_give_the_same_video_and_colors_as_its_pixels():
    rng = np.random.default_rng(0)
    frames = [
        cv2.GaussianBlur(rng.integers(0, 256, (240, 320, 3), np.uint8), (0, 0), 3) for _ in range(4)
    ]
    jpegs = [bytes(data) for data in encode_frames(np.stack(frames))]
    pixels, planes = [decode_frame(jpeg) for jpeg in jpegs], list(decoded_planes(jpegs))
    counted, rows = PlaneCounts(), {*range(0, 12, 2), *range(1, 12, 4), 11}
    assert list(counted.passing(planes * 3, rows)) == planes * 3
    of_planes, of_pixels = (encode(images, 15, Codec(crf=5)) for images in (planes, pixels))
    for (_, a), (_, b), want in zip(
        frames_of(io.BytesIO(of_planes)), frames_of(io.BytesIO(of_pixels)), pixels, strict=True
    ):
        assert (
            np.abs(a.astype(int) - want).mean() < 1.02 * np.abs(b.astype(int) - want).mean() + 0.1
        )
    got, wanted = counted.counts(), color_counts([(pixels * 3)[row] for row in rows])
    assert got.sum() == wanted.sum() and len(rows) > TOGETHER
    np.testing.assert_allclose(
        got @ np.arange(256) / got.sum(1), wanted @ np.arange(256) / wanted.sum(1), atol=0.3
    )


@pytest.mark.parametrize("spoil", [lambda j: j[:300], lambda j: b"", lambda j: b"no image" * 20])
def test_planes_of_a_damaged_jpeg_are_refused(spoil):
    jpeg = bytes(encode_frames(np.full((1, 32, 32, 3), 90, np.uint8))[0])
    with pytest.raises(EpisodeError, match="does not decode"):
        list(decoded_planes([jpeg, spoil(jpeg)]))


def test_settings_that_an_encoder_clips_are_refused():
    for codec, said in (
        (Codec("h264", crf=52), "--crf 52: h264 takes 0 to 51"),
        (Codec("libsvtav1", crf=64), "--crf 64: libsvtav1 takes 0 to 63"),
    ):
        with pytest.raises(ExportError) as caught:
            codec.check()
        assert str(caught.value).startswith(said)
    Codec("h264", crf=51, preset="placebo").check()
    Codec("libsvtav1", crf=63, preset="13").check()
    for codec in (Codec("h264", preset="12"), Codec("libsvtav1", preset="ultrafast")):
        with pytest.raises(ExportError, match="cannot encode with"):
            encode(clip(2, 0), FPS, codec)
