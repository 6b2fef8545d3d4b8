"""What the episode files of a dataset hold, for readers that run without domino-data."""

import io
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
from PIL import Image


class StoredEpisode:
    """One episode file below a dataset, read with h5py."""

    def __init__(self, dataset: Path, source: str) -> None:
        self._file = h5py.File(dataset / source, "r")
        self.state, self.action = self["joint_state/vector"], self["joint_action/vector"]
        self.sentences = {text.decode() for text in self["instruction/seen"]}

    def __getitem__(self, key: str) -> np.ndarray:
        return self._file[key][()]

    def __len__(self) -> int:
        return len(self.state)

    def image(self, camera: str, frame: int) -> np.ndarray:
        """An image (H,W,3) in true RGB."""
        return np.asarray(Image.open(io.BytesIO(bytes(self[f"observation/{camera}/rgb"][frame]))))

    def depth(self, camera: str) -> np.ndarray | None:
        """Depth (T,H,W) in mm, or None."""
        key = f"observation/{camera}/depth"
        return self[key] if key in self._file else None


def episodes(dataset: Path, table: Path) -> list[StoredEpisode]:
    """Episodes of an episodes.parquet in its order."""
    return [StoredEpisode(dataset, source) for source in pq.read_table(table)["source"].to_pylist()]


def close(a: np.ndarray, b: np.ndarray, most: float) -> bool:
    """Whether two images differ by at most so much on average, of 255."""
    return a.shape == b.shape and float(np.abs(a.astype(float) - b).mean()) <= most
