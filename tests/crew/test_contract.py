"""The contract of the crew."""

import pytest

from pipeline.crew.contract import CrewError, pick_executor


def test_without_ray_the_run_is_inline_unless_workers_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("pipeline.crew.contract.find_spec", lambda _: None)
    assert pick_executor("auto", None) == pick_executor("auto", 1) == ("inline", 1)
    for name, workers in (("auto", 3), ("ray", None)):
        with pytest.raises(CrewError):
            pick_executor(name, workers)
