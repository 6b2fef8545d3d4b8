"""The dataset that the tests of commands share."""

from tests.run.conftest import built

__all__ = ["built"]
