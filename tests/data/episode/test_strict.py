"""Files of strangers: nothing outside an episode file is read, and no group within itself is walked
for ever."""

import shutil

import h5py
import numpy as np
import pytest

from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.slots.annotations import CorruptAnnotation, read_entry
from pipeline.run.checks.file_checks import FileJob, judge
from tests.synthetic import make_episode

SECRET = b"canary, not of this file"
FRAMES = 3


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    return make_episode(tmp_path_factory.mktemp("strict") / "e.hdf5", frames=FRAMES)


def replaced(name, **options):
    def edit(file, _):
        del file[name]
        file.create_dataset(name, **options)

    return edit


def external(name, shape, dtype):
    def edit(file, outside):
        del file[name]
        size = np.dtype(dtype).itemsize * int(np.prod(shape))
        file.create_dataset(name, shape, dtype, external=[(str(outside / "secret"), 0, size)])

    return edit


def linked(name, link):
    def edit(file, outside):
        del file[name]
        file[name] = link(outside)

    return edit


def virtual(name):
    def edit(file, outside):
        shape = file[name].shape
        layout = h5py.VirtualLayout(shape, "f8")
        layout[:] = h5py.VirtualSource(outside / "other.hdf5", name, shape)
        del file[name]
        file.create_virtual_dataset(name, layout)

    return edit


def cycle(file, _):
    file["interception/again"] = file["interception"]


def second_name(file, _):
    file["target/velocity2"] = file["target/velocity"]


def filtered(file, _):
    values = file["state/qpos"][:]
    del file["state/qpos"]
    file.create_dataset("state/qpos", data=values, chunks=True, compression="lzf")


def compact(file, _):
    values = file["timestamp"][:]
    del file["timestamp"]
    made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    made.set_layout(h5py.h5d.COMPACT)
    space = h5py.h5s.create_simple(values.shape)
    new = h5py.h5d.create(file.id, b"timestamp", h5py.h5t.IEEE_F64LE, space, made)
    new.write(h5py.h5s.ALL, h5py.h5s.ALL, values)


def wrong(name, value):
    def edit(file, _):
        file[name][0] = value

    return edit


KINDS = {
    "external": external("target/velocity", (FRAMES, 3), "u1"),
    "external texts": external("observation/head_camera/rgb", (FRAMES,), "S8"),
    "ExternalLink": linked("instruction/seen", lambda d: h5py.ExternalLink(d / "other.hdf5", "/x")),
    "SoftLink": linked("instruction/seen", lambda _: h5py.SoftLink("/instruction/unseen")),
    "soft group": linked("interception", lambda _: h5py.SoftLink("/state")),
    "virtual": virtual("state/poses"),
    "no frames": replaced("timestamp", data=np.zeros(0)),
    "infinite": wrong("state/poses", np.inf),
    "NaN": wrong("target/pose", np.nan),
    "cycle": cycle,
    "second name": second_name,
    "opaque": replaced("observation/head_camera/rgb", data=np.zeros(FRAMES, "V99")),
    "numbers for texts": replaced("instruction/seen", data=np.zeros(3)),
    "references": replaced("motion", shape=(), dtype=h5py.ref_dtype),
    "filter": filtered,
    "compact": compact,
    "no values": replaced("target/pose", data=h5py.Empty("f8")),
}


@pytest.fixture
def outside(tmp_path, episode):
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "secret").write_bytes(SECRET * 20)
    shutil.copy(episode, folder / "other.hdf5")
    with h5py.File(folder / "other.hdf5", "r+") as file:
        file["x"] = np.array([SECRET.decode()], h5py.string_dtype())
    return folder


def read_all(path):
    with EpisodeFile(path) as file:
        assert file.damaged() is not None
        len(file)
        file.read()
        for camera in file.cameras:
            list(file.frames(camera))


def test_a_sound_episode_is_read(episode):
    read_all(episode)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_plain_data_of_the_schema_is_refused_in_one_line(
    kind, episode, outside, tmp_path
):
    root = tmp_path / "set"
    path = root / "episodes/click_bell/aloha-agilex/L1/clean/episode_0000000.hdf5"
    path.parent.mkdir(parents=True)
    shutil.copy(episode, path)
    with h5py.File(path, "r+") as file:
        KINDS[kind](file, outside)
    with pytest.raises(EpisodeError) as refused:
        read_all(path)
    assert "\n" not in str(refused.value) and "canary" not in str(refused.value)
    [*_, problem] = judge(FileJob(str(root), path.relative_to(root).as_posix()))
    assert "canary" not in problem
    assert judge(FileJob(str(root), "episodes/none.hdf5")) != []


@pytest.mark.parametrize("kind", ["external", "soft", "lzf"])
def test_annotations_are_as_strict(kind, outside, tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"key": "k", "attributes": "{}", "checksum": "c"})
        if kind == "soft":
            file["flow"] = h5py.ExternalLink(outside / "other.hdf5", "/x")
        else:
            options = {"compression": "lzf"} if kind == "lzf" else {}
            if kind == "external":
                options = {"external": [(str(outside / "secret"), 0, 16)]}
            file.create_dataset("flow", (16,), "u1", **options)
    with pytest.raises(CorruptAnnotation, match="cannot be read"):
        read_entry(path)
