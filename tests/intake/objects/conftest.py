"""Where the tests put objects."""

import pytest

from pipeline.intake.objects.add import Options
from pipeline.world.objects.contract import FAMILIES


@pytest.fixture
def options(tmp_path):
    """Where objects go; those that are registered meanwhile are taken out again."""
    before = set(FAMILIES)
    yield Options("thing", "tea_box", tmp_path / "plugins")
    for name in set(FAMILIES) - before:
        FAMILIES.remove(name)
