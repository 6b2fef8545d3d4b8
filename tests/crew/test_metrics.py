"""What a build on a cluster counts for those who watch it."""

import pytest

pytest.importorskip("ray")

from pipeline.crew.contract import Crew
from pipeline.crew.progress import COUNTERS, Metrics

CELL = {
    "task": "click_bell",
    "embodiment": "aloha-agilex",
    "level": "2",
    "alpha": "0.1",
    "domain": "clean",
}


@pytest.fixture
def counted(monkeypatch):
    """What counters of Ray are told: name, value and labels, which must be those that they were
    made with."""
    told = []

    class Counter:
        def __init__(self, name, description, tag_keys):
            assert description == COUNTERS[name]
            self.name, self.keys = name, set(tag_keys)

        def inc(self, value, tags):
            assert set(tags) == self.keys and all(isinstance(tag, str) for tag in tags.values())
            told.append((self.name, value, tags))

    monkeypatch.setattr("ray.util.metrics.Counter", Counter)
    return told


def ended(metrics):
    failed = CELL | {"reason": "no_path", "outcome": "failed"}
    accepted = CELL | {"reason": "", "outcome": "accepted"}
    metrics.add([failed, failed, accepted], {"dry_run": 1.5, "dry_run.cpu": 1.0, "mend": 0.0})
    metrics.add([failed], {})
    metrics.count_lost()


def test_slots_attempts_seconds_and_lost_workers_are_counted(counted):
    ended(Metrics(Crew("ray", 2, address="10.0.0.1:6379")))
    failure = ("domino_attempts", 1, CELL | {"reason": "no_path"})
    assert counted == [
        failure,
        failure,
        ("domino_attempts", 1, CELL | {"reason": "accepted"}),
        ("domino_slots", 1, CELL | {"outcome": "accepted"}),
        ("domino_phase_seconds", 1.5, {"phase": "dry_run"}),
        failure,
        ("domino_slots", 1, CELL | {"outcome": "given_up"}),
        ("domino_workers_lost", 1, {}),
    ]


def test_a_build_without_a_cluster_counts_nothing(counted):
    ended(Metrics(Crew("ray", 2)))
    ended(Metrics(Crew()))
    assert counted == []
