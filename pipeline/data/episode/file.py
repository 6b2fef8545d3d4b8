"""The episode file: one HDF5 an episode (docs/formats.md)."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5g, h5o, h5s  # pyright: ignore[reportAttributeAccessIssue]
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.data.errors import DAMAGE, one_line
from pipeline.data.names import LONGEST, SIDES, is_name, sides_of
from pipeline.data.parsing import first_fault, parse_json
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Pixels

from .frames import EpisodeError, decode_frame, stated_size
from .hdf5 import HASHES, check_dataset, content_hashes, differing, open_hdf5
from .meta import EpisodeMeta
from .state_log import Event, SkillRun, StateLog, Touch

SCHEMA = 4  # version of the layout (docs/formats.md): a file of another one is not read

SPLITS = ("seen", "unseen", "seen_after", "unseen_after")
"""Lists of instructions; the last two if an event changed what is asked for."""

FIRST_CONTACT, ATTEMPTS = "interception/first_contact", "attempts"
INFLATION = 4000  # no dataset is larger than its file by more: gzip shortens a thousandfold


@dataclass(eq=False)
class Episode:
    """What one file holds but images, which `EpisodeFile` reads on demand.

    `attempts` are those at its slot, none of a variant.
    """

    spec: EpisodeSpec
    log: StateLog
    motion: str
    instructions: Mapping[str, list[str]]
    meta: EpisodeMeta
    cameras: tuple[str, ...] = field(default=())
    interception: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    attempts: Sequence[Mapping[str, Any]] = ()


class EpisodeFile(AbstractContextManager["EpisodeFile"]):
    """Read access to one episode file; raises EpisodeError for what is no episode."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        try:
            self._file = open_hdf5(self.path)
            self._bytes = self.path.stat().st_size
        except (OSError, RuntimeError) as error:
            raise EpisodeError(
                f"{self.path}: cannot be read as HDF5 ({one_line(error)}); run the build again"
            ) from error
        try:
            schema = self._file.attrs.get("schema")
        except DAMAGE:
            schema = None
        if not isinstance(schema, np.integer) or schema != SCHEMA:
            self._file.close()
            fix = "it was written by another version of domino-data"
            raise EpisodeError(f"{self.path}: its schema is not {SCHEMA}; {fix}")

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @contextmanager
    def _reading(self, what: str) -> Iterator[None]:
        """Raise EpisodeError for damage."""
        try:
            yield
        except DAMAGE as error:
            raise EpisodeError(f"{self.path}: {what} ({one_line(error)})") from error

    def __len__(self) -> int:
        if frames := self._check("timestamp").shape[0]:
            return frames
        raise EpisodeError(f"{self.path}: has no frames")

    def has(self, key: str) -> bool:
        """Whether the file has a dataset or group."""
        with self._reading(f"{key} cannot be read"):
            return key in self._file

    def array(self, key: str) -> NDArray[Any]:
        """A whole dataset, e.g. "joint_state/vector" (T,A)."""
        dataset = self._check(key)
        with self._reading(f"{key} cannot be read"):
            if dataset.get_space().get_simple_extent_type() == h5s.NULL:
                raise ValueError("it has no values")
            values = np.empty(dataset.shape, dataset.dtype)
            dataset.read(h5s.ALL, h5s.ALL, values)
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise EpisodeError(f"{self.path}: {key} holds values that are not finite")
        return values

    def optional(self, key: str) -> NDArray[Any] | None:
        """A whole dataset, None if there is none of that name."""
        return self.array(key) if self.has(key) else None

    def _check(self, key: str) -> Any:
        found: Any = self._get(key)
        if not isinstance(found, h5d.DatasetID):
            raise EpisodeError(f"{self.path}: has no {key}")
        with self._reading(f"{key} cannot be read"):
            check_dataset(found)
        size = found.get_space().get_simple_extent_npoints() * found.get_type().get_size()
        if size > INFLATION * self._bytes:
            raise EpisodeError(f"{self.path}: {key} claims {size} bytes, more than the file holds")
        return found

    def _group(self, key: str) -> h5py.Group:
        found = self._get(key)
        if not isinstance(found, h5g.GroupID):
            raise EpisodeError(f"{self.path}: has no group {key}")
        return h5py.Group(found)

    def _get(self, key: str) -> object:
        """The identifier of an HDF5 object, or None: faster than h5py's objects."""
        with self._reading(f"{key} cannot be read"), suppress(KeyError):
            return h5o.open(self._file.id, key.encode())

    @property
    def cameras(self) -> tuple[str, ...]:
        """Sorted names."""
        with self._reading("observation cannot be read"):
            names = tuple(self._group("observation"))
        if wrong := [name for name in names if not is_name(name)]:
            name = f"observation/{wrong[0][:LONGEST]}"
            raise EpisodeError(f"{self.path}: {name} is not the name of a camera")
        return names

    @property
    def spec(self) -> EpisodeSpec:
        with self._reading("its spec cannot be used"):
            return EpisodeSpec.from_json(str(self._file.attrs["spec"]))

    @cached_property
    def meta(self) -> EpisodeMeta:
        try:
            with self._reading("has no attribute meta"):
                text = str(self._file.attrs["meta"])
            return EpisodeMeta.model_validate_json(text)
        except ValidationError as error:
            what = f"its meta attribute cannot be used: {first_fault(error)}"
            raise EpisodeError(f"{self.path}: {what}") from error

    @property
    def fps(self) -> int:
        return self.meta.fps

    def instructions(self, split: str = "seen") -> list[str]:
        """The instructions of one of SPLITS."""
        with self._reading(f"instruction/{split} is no list of texts"):
            return [s.decode() for s in self.array(f"instruction/{split}")]

    def jpeg(self, camera: str, frame: int) -> bytes:
        """One frame as JPEG (true RGB)."""
        key = f"observation/{camera}/rgb"
        with self._reading(f"{key} cannot be read"):
            return bytes(h5py.Dataset(self._check(key))[frame])

    def size(self, camera: str) -> tuple[int, int]:
        """Height and width that a camera's first image states."""
        width, height = stated_size(self.jpeg(camera, 0))
        return height, width

    def rgb(self, camera: str, frame: int) -> Pixels:
        """One decoded frame (H,W,3)."""
        return decode_frame(self.jpeg(camera, frame))

    def frames(self, camera: str) -> Iterator[Pixels]:
        """All decoded frames (H,W,3) of a camera."""
        for data in self.array(f"observation/{camera}/rgb"):
            yield decode_frame(bytes(data))

    def names(self, group: str, attribute: str) -> tuple[str, ...]:
        """The names in a group's attribute, such as "bodies" and "joints" of state."""
        attributes = self._group(group).attrs
        with self._reading(f"group {group} has no attribute {attribute}"):
            return tuple(map(str, np.asarray(attributes[attribute]).tolist()))

    def attempts(self) -> list[dict[str, Any]] | None:
        """The attempts at the episode's slot, itself the last; None in files of version 0.1."""
        with self._reading(f"{ATTEMPTS} is no list of attempts"):
            rows = self.optional(ATTEMPTS)
            return None if rows is None else [dict(row) for row in parse_json(rows.item())]

    def _touches(self) -> list[Touch]:
        columns = [
            self.array(f"{FIRST_CONTACT}/{name}").tolist()
            for name in ("step", "point", "points", "tcp", "target")
        ]
        return [
            Touch(side, step, tuple(point), points, tuple(tcp), tuple(target))
            for side, step, point, points, tcp, target in zip(SIDES, *columns, strict=True)
            if step >= 0
        ]

    def interception(self) -> dict[str, NDArray[Any]]:
        """The arrays of the group `interception` by key, but for the first contacts."""
        waiting, found = ["interception"], dict[str, NDArray[Any]]()
        while waiting:
            key = waiting.pop(0)
            if isinstance(self._get(key), h5g.GroupID):
                with self._reading(f"{key} cannot be read"):
                    inner = [f"{key}/{name}" for name in self._group(key)]
                waiting = [each for each in inner if each != FIRST_CONTACT] + waiting
            else:
                found[key.removeprefix("interception/")] = self.array(key)
        return found

    def damaged(self) -> list[str]:
        """Names of changed, missing or unexpected datasets; HEADER for attributes."""
        with self._reading("its content cannot be read"):
            written = dict(parse_json(str(self._file.attrs[HASHES])))
            return differing(written, self.contents())

    def contents(self) -> dict[str, str]:
        """The hash of every dataset by name, and of the attributes under HEADER."""
        with self._reading("its content cannot be read"):
            return content_hashes(self._file, lambda dataset: self.array(str(dataset.name)[1:]))

    def read(self) -> Episode:
        """The episode without its images."""
        with self._reading("is not a complete episode"):
            vector_names = self.names("joint_state", "names")
            tcp = [self.array(f"endpose/{side}_endpose") for side in sides_of(vector_names)]
            runs = parse_json(self.array("skills").item())
            log = StateLog(
                times=self.array("timestamp"),
                bodies=self.names("state", "bodies"),
                poses=self.array("state/poses"),
                joints=self.names("state", "joints"),
                qpos=self.array("state/qpos"),
                qvel=self.array("state/qvel"),
                vector_names=vector_names,
                state=self.array("joint_state/vector"),
                action=self.array("joint_action/vector"),
                tcp=np.stack(tcp, axis=1),
                target_velocity=self.array("target/velocity"),
                contacts=self.array("state/contacts"),
                events=[Event(**each) for each in json.loads(self.array("events").item())],
                skills=[SkillRun(**(run | {"arms": tuple(run["arms"])})) for run in runs],
                touches=self._touches(),
                target_angular_velocity=self.optional("target/angular_velocity"),
                intervention=self.optional("intervention"),
                expert_action=self.optional("expert_action"),
            )
            stored = [s for s in SPLITS if s in ("seen", "unseen") or self.has(f"instruction/{s}")]
            split = {s: self.instructions(s) for s in stored}
            motion, tried = self.array("motion").item().decode(), self.attempts() or ()
            return Episode(
                self.spec, log, motion, split, self.meta, self.cameras, self.interception(), tried
            )


open_episode = EpisodeFile  # `with open_episode(path) as episode:`
