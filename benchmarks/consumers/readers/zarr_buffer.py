# /// script
# requires-python = ">=3.12,<3.13"
# dependencies = ["zarr", "numcodecs", "numpy", "h5py", "pyarrow", "pillow"]
# ///
"""Reads an export of format zarr with zarr as Diffusion Policy and DP3 do, and compares every row
with the episode files.

domino-data export OUT --format zarr uv run --script benchmarks/consumers/readers/zarr_buffer.py OUT
uv run --with "zarr<3" --with "numcodecs<0.16" --script benchmarks/consumers/readers/zarr_buffer.py
OUT

With a checkout of Diffusion Policy or 3D-Diffusion-Policy on PYTHONPATH (and zarr below 3), its own
ReplayBuffer reads as well.
"""

import importlib
import sys
from pathlib import Path

import numpy as np
import zarr
from stored import close, episodes

CAMERAS = {"img": "head_camera", "left_camera": "left_camera", "right_camera": "right_camera"}


def windows(ends: np.ndarray, length: int) -> list[tuple[int, int]]:
    """Rows of every sequence of a length that lies within one episode, which is what both samplers
    train on."""
    starts = [0, *ends[:-1]]
    return [
        (i, i + length)
        for low, high in zip(starts, ends, strict=True)
        for i in range(low, high - length + 1)
    ]


def main() -> None:
    dataset = Path(sys.argv[1])
    for store in sorted((dataset / "exports" / "zarr").rglob("*.zarr")):
        root = zarr.open(str(store), mode="r")
        data, ends = (
            {key: root["data"][key][:] for key in root["data"]},
            root["meta"]["episode_ends"][:],
        )
        assert ends.dtype == np.int64 and all(len(values) == ends[-1] for values in data.values())
        files = episodes(dataset, store.parent / "episodes.parquet")
        assert len(files) == len(ends)
        for episode, start, end in zip(files, [0, *ends[:-1]], ends, strict=True):
            assert end - start == len(episode)
            np.testing.assert_array_equal(
                data["state"][start:end], episode.state.astype(np.float32)
            )
            np.testing.assert_array_equal(
                data["action"][start:end], episode.action.astype(np.float32)
            )
            for name, camera in CAMERAS.items():
                assert all(
                    close(data[name][start + t], episode.image(camera, t), 2)
                    for t in range(len(episode))
                )
                if (depth := episode.depth(camera)) is not None:
                    np.testing.assert_array_equal(data[f"depth_{name}"][start:end], depth)
            if "point_cloud" in data:
                np.testing.assert_array_equal(data["point_cloud"][start:end], episode["pointcloud"])
        low, high = windows(ends, 8)[-1]
        np.testing.assert_array_equal(
            data["action"][low:high], files[-1].action[-8:].astype(np.float32)
        )
        print(
            f"{store.parent.name}: {len(ends)} episodes, {ends[-1]} rows, zarr {zarr.__version__}"
        )
        for package in ("diffusion_policy", "diffusion_policy_3d"):
            if importlib.util.find_spec(package):
                check_buffer(package, store, data)


def check_buffer(package: str, store: Path, data: dict[str, np.ndarray]) -> None:
    """Read with the ReplayBuffer and the SequenceSampler of a checkout."""
    buffers = importlib.import_module(f"{package}.common.replay_buffer")
    samplers = importlib.import_module(f"{package}.common.sampler")
    keys = ["state", "action", "img"] + ["point_cloud"] * ("point_cloud" in data)
    buffer = buffers.ReplayBuffer.copy_from_path(str(store), keys=keys)
    sampler = samplers.SequenceSampler(buffer, sequence_length=16, pad_before=1, pad_after=7)
    sample = sampler.sample_sequence(1)
    for key in keys:
        np.testing.assert_array_equal(buffer[key], data[key])
        np.testing.assert_array_equal(sample[key], data[key][:16])
    print(
        f"  {package}: ReplayBuffer has {buffer.n_episodes} episodes, the sampler {len(sampler)}"
        " sequences"
    )


if __name__ == "__main__":
    main()
