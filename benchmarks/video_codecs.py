"""What each video codec, preset and quality costs: time to encode, time to read one frame at
random, bytes, error.

    python -m benchmarks.video_codecs --episode FILE ... [--frames 60]

Frames of all cameras of the episodes. "Error" is the mean absolute difference (0-255) over the
image; "moved" over the pixels that differ by more than 32 from the frame before, where a codec that
draws late is seen. A row is on the front (*) when no other encodes as fast with as little error
where things moved and as few bytes.
"""

import argparse
import io
import time
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import open_episode
from pipeline.export.shared.video import Codec, encode, frames_of

FPS = 15
LEROBOT = Codec("libsvtav1", 30, 2, "12")
TRIED = (
    LEROBOT,
    *(Codec("libsvtav1", crf, 1, preset) for preset in ("10", "12", "13") for crf in (24, 32)),
    *(
        Codec("h264", crf, 1, preset)
        for preset in ("ultrafast", "superfast", "veryfast", "medium")
        for crf in (17, 18, 20, 21, 23, 26)
    ),
    *(Codec("h264", crf, 2, "veryfast") for crf in (18, 23)),
    *(Codec("hevc", crf, 1, preset) for preset in ("ultrafast", "veryfast") for crf in (20, 25)),
)


@dataclass(frozen=True)
class CodecRow:
    """Measurements of one codec: CPU ms to encode a frame, ms to read one at random, kB a frame,
    errors of 0-255."""

    codec: Codec
    encode: float
    decode: float
    size: float
    error: float
    moved: float

    def beats(self, other: "CodecRow") -> bool:
        """Whether it is as good in time, error and size, and better in one of them."""
        mine, its = (self.encode, self.moved, self.size), (other.encode, other.moved, other.size)
        return all(a <= b for a, b in zip(mine, its, strict=True)) and mine != its


def measure(clips: list[list[NDArray[np.uint8]]], codec: Codec, reads: int) -> CodecRow:
    """Encode each clip, read `reads` frames of each at random, compare all."""
    spent, decoding, size, errors, moved = 0.0, [], 0, [], []
    encode(clips[0][:4], FPS, codec)  # the first call of an encoder sets it up
    for number, frames in enumerate(clips):
        start = time.process_time()
        mp4 = encode(frames, FPS, codec)
        spent += time.process_time() - start
        size += len(mp4)
        for t, (_, image) in enumerate(frames_of(io.BytesIO(mp4))):
            errors.append(float(cv2.absdiff(image, frames[t]).mean()))
            changed = cv2.absdiff(frames[t], frames[max(t - 1, 0)]).max(-1) > 32
            if changed.any():
                moved.append(float(cv2.absdiff(image, frames[t])[changed].mean()))
        for t in np.random.default_rng(number).integers(0, len(frames), reads):
            start = time.process_time()
            read_one(mp4, int(t))
            decoding.append(time.process_time() - start)
    count = sum(map(len, clips))
    return CodecRow(
        codec,
        1e3 * spent / count,
        1e3 * float(np.mean(decoding)),
        size / count / 1e3,
        float(np.mean(errors)),
        float(np.mean(moved)),
    )


def read_one(mp4: bytes, frame: int) -> NDArray[np.uint8]:
    """One frame of a video as a loader reads it: open, seek to the key frame at or before it,
    decode up to it."""
    with av.open(io.BytesIO(mp4), "r") as container:
        stream = container.streams.video[0]
        stream.thread_count = 1
        assert stream.time_base is not None
        at = round(frame / FPS / stream.time_base)
        container.seek(at, stream=stream)
        for decoded in container.decode(stream):
            if decoded.pts >= at:
                return np.asarray(decoded.to_ndarray(format="rgb24"), np.uint8)
    raise ValueError(f"the video has no frame {frame}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episode", type=Path, nargs="+", required=True)
    parser.add_argument(
        "--frames",
        type=int,
        default=60,
        help="frames of each camera, from the start of the episode",
    )
    parser.add_argument("--reads", type=int, default=20, help="random reads of each video")
    args = parser.parse_args()
    clips = []
    for path in args.episode:
        with open_episode(path) as e:
            clips += [list(e.frames(camera))[: args.frames] for camera in e.cameras]
    print(
        f"{len(clips)} clips, {sum(map(len, clips))} frames of {clips[0][0].shape[1]} pixels wide,"
        " one thread, CPU time\n"
    )
    rows = [measure(clips, codec, args.reads) for codec in TRIED]
    print(
        "| codec | preset | crf | key frame every | encode ms | random read ms | kB a frame | error"
        " | error, moved | front |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for row in rows:
        c = row.codec
        front = "" if any(other.beats(row) for other in rows) else "*"
        values = (
            f"{row.encode:.2f} | {row.decode:.2f} | {row.size:.2f} | {row.error:.2f} |"
            f" {row.moved:.2f}"
        )
        print(
            f"| {c.name} | {c.options()['preset']} | {c.quality} | {c.gop} | {values} | {front} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
