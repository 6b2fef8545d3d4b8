"""`domino-data verify`: re-check what a dataset promises, from the files alone, each file by itself."""

from pipeline.run.verify.dataset import verify
from pipeline.run.verify.tally import closing

__all__ = ["closing", "verify"]
