"""What is taken out of garbage collection, and what stays in it."""

import gc

import pytest

from pipeline.garbage import settled


def test_a_block_looks_at_new_objects_only():
    old = [{"a": []} for _ in range(1000)]
    before = gc.get_freeze_count()
    with settled():
        assert gc.get_freeze_count() >= before + len(old)
        new: list[object] = []
        new.append(new)
        assert any(each is new for each in gc.get_objects())
        assert not any(each is old for each in gc.get_objects())
    assert gc.get_freeze_count() == 0
    assert any(each is old for each in gc.get_objects())


def test_an_error_leaves_nothing_out():
    with pytest.raises(ValueError, match="why"), settled():
        raise ValueError("why")
    assert gc.get_freeze_count() == 0
