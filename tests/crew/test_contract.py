"""Which executor a run gets."""

import pytest

from pipeline.crew.contract import pick_executor


def test_without_ray_the_run_is_inline(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pipeline.crew.contract.find_spec", lambda _: None)
    assert pick_executor("auto", 3) == ("inline", 1)
    assert pick_executor("ray", 3) == ("ray", 3)
