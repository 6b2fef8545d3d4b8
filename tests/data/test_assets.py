"""The store of assets: each once, under the hash of its content; damage is named."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.data.slots.assets import AssetError, AssetStore

ARRAYS = {
    "vertices": np.arange(300, dtype=np.float32).reshape(100, 3),
    "triangles": np.arange(30, dtype=np.uint32).reshape(10, 3),
}
ATTRIBUTES = [{"color": [0.1, 0.2, 0.3], "texture": None}]


def test_what_is_put_is_got_and_kept_once(tmp_path):
    store = AssetStore(tmp_path)
    key = store.put(ARRAYS, ATTRIBUTES)
    assert (
        store.put({name: array.copy() for name, array in reversed(ARRAYS.items())}, ATTRIBUTES)
        == key
    )
    arrays, attributes = store.get(key)
    assert attributes == ATTRIBUTES and set(arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert (arrays[name].dtype, arrays[name].tobytes()) == (array.dtype, array.tobytes())
    assert len([p for p in tmp_path.rglob("*") if p.is_file()]) == 1
    other = store.put(ARRAYS | {"triangles": ARRAYS["triangles"] + 1}, ATTRIBUTES)
    assert other != key != store.put(ARRAYS, [*ATTRIBUTES, {}])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(st.data())
def test_a_damaged_asset_is_one_line_or_the_same(tmp_path, data):
    store = AssetStore(tmp_path)
    key = store.put(ARRAYS, ATTRIBUTES)
    path = store.path(key)
    whole = path.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    path.write_bytes(
        data.draw(
            st.sampled_from([whole[:at], whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]])
        )
    )
    try:
        arrays, attributes = store.get(key)
    except AssetError as error:
        assert str(path) in str(error) and "\n" not in str(error)
    else:  # a byte that means nothing, such as a date in the archive's directory
        assert attributes == ATTRIBUTES and all(
            (arrays[name] == ARRAYS[name]).all() for name in ARRAYS
        )
    path.write_bytes(whole)


@pytest.mark.parametrize("key", ["", "../../etc/passwd", "g" * 32, "A" * 32, "0" * 31])
def test_only_hashes_are_names_of_assets(tmp_path, key):
    with pytest.raises(AssetError, match="not the hash"):
        AssetStore(tmp_path).get(key)
    with pytest.raises(AssetError, match="missing"):
        AssetStore(tmp_path).get("0" * 32)
