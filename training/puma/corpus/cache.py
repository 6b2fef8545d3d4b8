"""Decoded arrays of one dataset at the size of the network: NumPy files, memory-mapped, made once
and found again by their key.

    KEY/meta.json              names, rates, sizes, and the rows of episodes
    KEY/image_<camera>.npy     (N,h,w,3) uint8, or
    KEY/jpeg_<camera>.bin, ends_<camera>.npy  coded images, where each ends (N,): those that only the finder looks at
    KEY/past.npy               (N,fh,fw,3) uint8: the flow map that ends at the frame, or the frame itself, small
    KEY/state.npy, action.npy  (N,A) float32; time.npy (N,) s; position.npy (N,3) m of the target
    KEY/world.npy, valid.npy   (N,D) float16 of the target and whether it is known (N,)
    KEY/target.npy, camera.npy (N,7) world poses of the target and of the first camera, where the target is tracked
    KEY/goal.npy               (N,7) world poses of the second body, if one is tracked
    KEY/free.npy               (N,) whether the robot has not touched the target yet, likewise

N counts the frames of all episodes, one after the other.
"""  # noqa: E501

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.atomic import atomic_directory
from pipeline.data.episode.frames import EpisodeError, decode_frame
from pipeline.data.keys import digest
from training.puma.config import Config, MixtureSource
from training.puma.corpus.shards import Row, Shard, Shards
from training.puma.errors import TrainError
from training.puma.preprocess import color_maps, colour_of, resized

VERSION = 2
"""Raised whenever the code would make other arrays from the same input."""

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class CodedImages:
    """N images in their coded form: a number or a slice gives images (H,W,3) or (N,H,W,3)."""

    coded: NDArray[np.uint8]
    ends: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, which: Any) -> NDArray[np.uint8]:
        if isinstance(which, slice):
            return np.stack([self[i] for i in range(*which.indices(len(self)))])
        start = self.ends[which - 1] if which else 0
        return decode_frame(self.coded[start : self.ends[which]].tobytes())


@dataclass(eq=False)
class Cache:
    """The arrays of one dataset, and its coded images by camera. `start` (E,) is the first frame of
    each episode."""

    path: Path
    fps: int
    names: tuple[str, ...]
    source_sizes: dict[str, tuple[int, int]]
    rows: list[Row]
    arrays: Mapping[str, NDArray[Any]]
    coded: Mapping[str, CodedImages] = field(default_factory=dict[str, CodedImages])

    def images(self, camera: str) -> "NDArray[np.uint8] | CodedImages":
        """Images (N,H,W,3) of a camera."""
        return self.coded[camera] if camera in self.coded else self.arrays[f"image_{camera}"]

    @property
    def length(self) -> NDArray[np.int64]:
        """Frames of each episode (E,)."""
        return np.array([row.length for row in self.rows], np.int64)

    @property
    def start(self) -> NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.length)[:-1]])

    @property
    def taught(self) -> NDArray[np.int64]:
        """The first frame of each episode (E,) from which on the expert acts; past its last frame
        if it never does."""
        return np.minimum(self.start + [row.taught for row in self.rows], self.start + self.length)


def cache_root(config: Config) -> Path:
    """Where caches are kept."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return config.data.cache or home / "domino-data" / "puma"


def open_cache(source: MixtureSource, config: Config, tell: Tell = lambda text: None) -> Cache:
    """The cache of a dataset, made where it is missing. Raises TrainError for what `Shards` finds
    wrong."""
    shards = Shards(source, config)
    model, data = config.model, config.data
    parts = {
        "version": VERSION,
        "shards": shards.digest,
        "cameras": data.cameras,
        "sizes": [data.image_size, data.flow_size],
        "past": [model.history, asdict(colour_of(config))],
        "world": model.world,
    }
    corrected = True if shards.corrected else None
    options = {
        "track": True if model.track else None,
        "after_success": shards.after_success,
        "coded": None if model.looks else True,
        "goal": True if shards.goal else None,
        "corrected": corrected,
    }
    options["oracle"] = True if model.oracle else None
    path = cache_root(config) / digest(
        parts | {name: value for name, value in options.items() if value is not None}
    )
    if not (path / "meta.json").exists():
        tell(f"decoding {len(shards.rows)} episodes of {source.dataset} to {path}")
        try:
            with atomic_directory(path) as folder:
                _write(folder, shards, config)
        except EpisodeError as error:
            raise TrainError(
                f"{shards.root}: {error}; run: domino-data export {source.dataset} --format parquet"
            ) from error
    return _read(path)


def _read(path: Path) -> Cache:
    meta = json.loads((path / "meta.json").read_text())
    texts = ("instructions", "unseen")
    rows = [Row(**(row | {name: tuple(row[name]) for name in texts})) for row in meta["rows"]]
    arrays = {
        file.stem: np.load(file, mmap_mode="r", allow_pickle=False)
        for file in sorted(path.glob("*.npy"))
    }
    coded = {
        name: CodedImages(np.memmap(path / f"jpeg_{name}.bin", np.uint8, "r"), ends)
        for name in meta["source_sizes"]
        if (ends := arrays.pop(f"ends_{name}", None)) is not None
    }
    sizes = {name: (size[0], size[1]) for name, size in meta["source_sizes"].items()}
    return Cache(path, meta["fps"], tuple(meta["names"]), sizes, rows, arrays, coded)


def _write(folder: Path, shards: Shards, config: Config) -> None:
    names = {shards.names[row.embodiment] for row in shards.rows}
    if len(names) > 1:
        raise TrainError(
            f"{shards.dataset}: robots with different joints cannot share a run: choose one (where:"
            " embodiment=...)"
        )
    frames, place = sum(row.length for row in shards.rows), 0
    out: dict[str, NDArray[Any]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    rows, written = list[Row](), dict[str, int]()
    for shard in shards:
        arrays = _arrays(shard, config, sizes)
        for camera, jpegs in () if config.model.looks else shard.images.items():
            with (folder / f"jpeg_{camera}.bin").open("ab") as file:
                file.writelines(jpegs)
            lengths = [len(jpeg) for jpeg in jpegs]
            arrays[f"ends_{camera}"] = written.get(camera, 0) + np.cumsum(lengths)
            written[camera] = int(arrays[f"ends_{camera}"][-1])
        for name, values in arrays.items():
            if name not in out:
                shape = (frames, *values.shape[1:])
                out[name] = np.lib.format.open_memmap(
                    folder / f"{name}.npy", mode="w+", dtype=values.dtype, shape=shape
                )
            out[name][place : place + shard.row.length] = values
        place += shard.row.length
        rows.append(shard.row)
    for array in out.values():
        array.flush()  # pyright: ignore[reportAttributeAccessIssue]
    meta = {
        "fps": shards.fps,
        "names": names.pop(),
        "source_sizes": sizes,
        "rows": [asdict(row) for row in rows],
    }
    (folder / "meta.json").write_text(json.dumps(meta))


def _arrays(
    shard: Shard, config: Config, sizes: dict[str, tuple[int, int]]
) -> dict[str, NDArray[Any]]:
    """The arrays (T, ...) of one episode. `sizes` collects the image size of each camera."""
    model, data = config.model, config.data
    out: dict[str, NDArray[Any]] = {
        "time": shard.time,
        "state": shard.state,
        "action": shard.action,
        "position": shard.target[:, :3],
    }
    if model.oracle:
        out["target"] = shard.target
    if model.track:
        out |= {"target": shard.target, "camera": shard.camera, "free": ~shard.touched}
    if shard.goal is not None:
        out["goal"] = shard.goal
    for i, camera in enumerate(data.cameras):
        # what only the finder looks at stays coded; one image shows the size
        jpegs = (
            shard.images[camera]
            if model.looks or model.history == "frames"
            else shard.images[camera][:1]
        )
        images = [decode_frame(jpeg) for jpeg in jpegs]
        shape = images[0].shape[:2]
        if sizes.setdefault(camera, (shape[0], shape[1])) != shape:
            raise TrainError(
                f"{shard.row.source}: images of {camera} are {shape[0]}x{shape[1]}, others"
                f" {sizes[camera]}"
            )
        if model.looks:
            out[f"image_{camera}"] = np.stack([resized(image, data.image_size) for image in images])
        if i == 0 and model.history == "frames":
            out["past"] = np.stack([resized(image, data.flow_size) for image in images])
    if model.history == "flow":
        out["past"] = color_maps(shard.annotations["flow"]["flow"], colour_of(config))
    if model.world == "features":
        found = shard.annotations["features"]
        out["world"], out["valid"] = found["feature"].astype(np.float16), found["valid"]
    elif model.world == "boxes":
        found = shard.annotations["masks"]
        # corners (px) as fractions of the image
        out["world"] = (found["box"] / np.tile(found["size"], 2)).astype(np.float16)
        out["valid"] = found["valid"]
    return out
