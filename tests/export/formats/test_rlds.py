"""TFRecord files decoded with protobuf's own runtime; benchmarks/consumers/readers has
tensorflow_datasets read them."""

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from PIL import Image

from pipeline.data.episode.file import open_episode
from pipeline.export.formats.tfrecord import example, masked_crc, write_records
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

PLACE = "domino_aloha_agilex/1.0.0"


def example_class():
    """tf.train.Example, from its published definition."""
    kinds, field = descriptor_pb2.FieldDescriptorProto, {"label": 1}
    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="t", syntax="proto3")
    for name, kind in (
        ("BytesList", kinds.TYPE_BYTES),
        ("FloatList", kinds.TYPE_FLOAT),
        ("Int64List", kinds.TYPE_INT64),
    ):
        file.message_type.add(name=name).field.add(name="value", number=1, type=kind, label=3)
    feature = file.message_type.add(name="Feature")
    for number, name in enumerate(("BytesList", "FloatList", "Int64List"), 1):
        feature.field.add(
            name=name.lower(),
            number=number,
            type=kinds.TYPE_MESSAGE,
            type_name=f".t.{name}",
            **field,
        )
    features = file.message_type.add(name="Features")
    features.field.add(
        name="feature",
        number=1,
        type=kinds.TYPE_MESSAGE,
        type_name=".t.Features.FeatureEntry",
        label=3,
    )
    entry = features.nested_type.add(name="FeatureEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=kinds.TYPE_STRING, **field)
    entry.field.add(
        name="value", number=2, type=kinds.TYPE_MESSAGE, type_name=".t.Feature", **field
    )
    file.message_type.add(name="Example").field.add(
        name="features", number=1, type=kinds.TYPE_MESSAGE, type_name=".t.Features", **field
    )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("t.Example"))


def decoded(message: bytes) -> dict[str, list]:
    """Values by name of the feature."""
    features = example_class().FromString(message).features.feature
    return {name: list(getattr(f, f.ListFields()[0][0].name).value) for name, f in features.items()}


def read_records(path: Path) -> Iterator[bytes]:
    """The messages of a TFRecord file, checksums compared."""
    with path.open("rb") as f:
        while head := f.read(12):
            size, crc = struct.unpack("<QI", head)
            body = f.read(size + 4)
            assert (
                masked_crc(head[:8]) == crc
                and masked_crc(body[:-4]) == struct.unpack("<I", body[-4:])[0]
            )
            yield body[:-4]


def test_messages_are_read_by_protobuf():
    values = {
        "a": [b"x", b"y" * 300],
        "b": np.array([1.5, -2.25], np.float32),
        "c": np.array([0, -1, 2**40]),
    }
    assert decoded(example(values)) == {
        "a": [b"x", b"y" * 300],
        "b": [1.5, -2.25],
        "c": [0, -1, 2**40],
    }


def test_checksums_are_crc32c(tmp_path):
    # the values of RFC 3720, appendix B.4
    for data, crc in (
        (bytes(32), 0x8A9136AA),
        (bytes(range(32)), 0x46DD794E),
        (b"123456789", 0xE3069283),
    ):
        assert masked_crc(data) == ((crc >> 15 | crc << 17) + 0xA282EAD8) % 2**32
    path = tmp_path / "r"
    assert write_records(path, [b"one", b"three"]) == [3, 5]
    assert list(read_records(path)) == [b"one", b"three"]


def test_steps_are_the_frames(tmp_path):
    paths = [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=3 + i, depth=True)
        for i in range(3)
    ]
    out = tmp_path / "out"
    run("rlds", tmp_path, out, paths, shard_episodes=2)
    names = [f"domino_aloha_agilex-train.tfrecord-0000{i}-of-00002" for i in range(2)]
    messages = [message for name in names for message in read_records(out / PLACE / name)]
    info = json.loads((out / PLACE / "dataset_info.json").read_text())
    (split,) = info["splits"]
    assert (split["shardLengths"], int(split["numBytes"])) == (["2", "1"], sum(map(len, messages)))
    for path, values in zip(paths, map(decoded, messages), strict=True):
        with open_episode(path) as e:
            count, action = len(e), e.array("joint_action/vector")
            np.testing.assert_array_equal(
                np.array(values["steps/action"]).reshape(count, 14), action.astype(np.float32)
            )
            assert values["steps/is_first"] == [1] + [0] * (count - 1)
            assert (
                values["steps/reward"]
                == values["steps/is_terminal"]
                == values["steps/is_last"]
                == [0] * (count - 1) + [1]
            )
            assert values["steps/observation/cam_high"][1] == e.jpeg("head_camera", 1)
            depth = np.asarray(
                Image.open(io.BytesIO(values["steps/observation/depth_cam_high"][2]))
            )
            np.testing.assert_array_equal(depth, e.array("observation/head_camera/depth")[2])
            assert values["episode_metadata/level"] == [1]
            assert values["episode_metadata/file_path"] == [
                path.relative_to(tmp_path).as_posix().encode()
            ]
