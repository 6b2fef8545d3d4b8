"""Where the tests put objects."""

import pytest

from pipeline.intake.objects.add import Options
from pipeline.run.identity import code_parts
from pipeline.run.identity import slot_keys as keys
from pipeline.world.objects.contract import FAMILIES


@pytest.fixture
def options(tmp_path):
    """Where objects go; those that are registered meanwhile are taken out again."""
    before = set(FAMILIES)
    yield Options("thing", "tea_box", tmp_path / "plugins")
    for name in set(FAMILIES) - before:
        FAMILIES.remove(name)
    for cached in (keys._code_version, keys._slot_parts, code_parts.object_parts):
        cached.cache_clear()
