"""Looking through a dataset in a browser: an offline page for some episodes, a local server for
all."""

from pipeline.report.viewer.page import choose, write_viewer
from pipeline.report.viewer.serve import viewer_server

__all__ = ["choose", "viewer_server", "write_viewer"]
