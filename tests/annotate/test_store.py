"""Keys and the store: content decides, damage is found, the same result gives the same bytes."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.annotate.stage import AnnotateError, annotation_key, stage_key
from pipeline.annotate.store import check_entry, find_stage, write_entry, write_stage
from pipeline.data.keys import arrays_digest, frames_digest
from pipeline.data.slots.annotations import CorruptAnnotation, read_entry, stages_of

ARRAYS = {
    "flow": np.arange(24, dtype=np.float16).reshape(3, 2, 2, 2),
    "mask": np.eye(64, dtype=np.uint8)[None].repeat(3, 0),
}


def test_key_is_sha256_of_canonical_json_and_every_part_enters():
    key = annotation_key("flow", 1, {"b": 2, "a": 1}, {"frames": "f"})
    text = '{"inputs":{"frames":"f"},"parameters":{"a":1,"b":2},"stage":"flow","version":1}'
    assert key == hashlib.sha256(text.encode()).hexdigest()
    others = [
        annotation_key("masks", 1, {"a": 1, "b": 2}, {"frames": "f"}),
        annotation_key("flow", 2, {"a": 1, "b": 2}, {"frames": "f"}),
        annotation_key("flow", 1, {"a": 1, "b": 3}, {"frames": "f"}),
        annotation_key("flow", 1, {"a": 1, "b": 2}, {"frames": "g"}),
        annotation_key("flow", 1, {"a": 1, "b": 2}, {"frames": "f", "prompts": ["bell"]}),
    ]
    assert len({key, *others}) == 6
    assert annotation_key("flow", 1, {"a": 1, "b": 2}, {"frames": "f"}) == key
    assert len(stage_key("flow", 1, {})) == 8


@given(st.lists(st.binary(max_size=6), max_size=5), st.lists(st.binary(max_size=6), max_size=5))
def test_frame_sequences_do_not_run_together(a: list[bytes], b: list[bytes]):
    assert (frames_digest(a) == frames_digest(b)) == (a == b)


def test_arrays_digest_sees_name_type_shape_and_value_but_not_layout():
    a = np.arange(6, dtype=np.float32).reshape(2, 3)
    base = arrays_digest({"x": a})
    assert arrays_digest({"x": np.asfortranarray(a)}) == base
    assert arrays_digest({"x": a.astype(">f4")}) == base
    changed = a.copy()
    changed[1, 2] += 1
    assert (
        len(
            {
                base,
                *map(
                    arrays_digest,
                    ({"y": a}, {"x": a.reshape(3, 2)}, {"x": a.view(np.int32)}, {"x": changed}),
                ),
            }
        )
        == 5
    )


def test_write_read_and_states(tmp_path: Path):
    path = tmp_path / "a" / "episode.h5"
    assert check_entry(path, "k") == "missing"
    written = write_entry(path, "k", ARRAYS, {"prompts": ["bell"]}, compressed=("mask",))
    entry = read_entry(path)
    assert (entry.key, entry.attributes, entry.checksum) == (
        "k",
        {"prompts": ["bell"]},
        written.checksum,
    )
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(entry.arrays[name], array)
        assert entry.arrays[name].dtype == array.dtype
    assert check_entry(path, "k") == "valid"
    assert check_entry(path, "other") == "stale"
    assert [p.name for p in path.parent.iterdir()] == ["episode.h5"]


def test_same_content_gives_same_bytes(tmp_path: Path):
    for name in "ab":
        write_entry(tmp_path / name, "k", ARRAYS, {"n": 1}, compressed=("mask",))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.floats(0, 1, exclude_max=True), flip=st.integers(1, 255), cut=st.booleans())
def test_any_damage_is_found_or_harmless(tmp_path: Path, place: float, flip: int, cut: bool):
    path = tmp_path / "e.h5"
    write_entry(path, "k", ARRAYS, {"n": 1}, compressed=("mask",))
    data = bytearray(path.read_bytes())
    if cut:
        path.write_bytes(data[: int(place * len(data))])
    else:
        data[int(place * len(data))] ^= flip
        path.write_bytes(data)
    try:
        entry = read_entry(path)
    except CorruptAnnotation as error:
        assert str(path) in str(error)
        assert check_entry(path, "k") == "corrupt"
        return
    assert not cut
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(entry.arrays[name], array)


def test_a_text_that_is_none_any_more_is_corrupt(tmp_path: Path):
    path = tmp_path / "e.h5"
    write_entry(path, "k", ARRAYS, {"n": 1})
    path.write_bytes(path.read_bytes().replace(b'{"n":1}', b'{"\xbb":1}'))
    assert check_entry(path, "k") == "corrupt"


def test_flipped_array_byte_is_corrupt(tmp_path: Path):
    path = tmp_path / "e.h5"
    write_entry(path, "k", ARRAYS, {})
    data = path.read_bytes()
    at = data.index(ARRAYS["flow"].tobytes())
    path.write_bytes(data[: at + 9] + bytes([data[at + 9] ^ 1]) + data[at + 10 :])
    assert check_entry(path, "k") == "corrupt"


def test_failed_write_leaves_nothing(tmp_path: Path):
    with pytest.raises(TypeError):
        write_entry(tmp_path / "e.h5", "k", {"bad": np.array([object()])}, {})
    assert list(tmp_path.iterdir()) == []


def test_find_stage_by_parameters(tmp_path: Path):
    for directory, stride in (("flow@aaaaaaaa", 4), ("flow@bbbbbbbb", 2)):
        write_stage(
            tmp_path, directory, {"stage": "flow", "version": 1, "parameters": {"stride": stride}}
        )
    assert set(stages_of(tmp_path)) == {"flow@aaaaaaaa", "flow@bbbbbbbb"}
    assert find_stage(tmp_path, "flow", stride=2) == "flow@bbbbbbbb"
    with pytest.raises(AnnotateError, match="several flow"):
        find_stage(tmp_path, "flow")
    with pytest.raises(AnnotateError, match="no masks"):
        find_stage(tmp_path, "masks")
