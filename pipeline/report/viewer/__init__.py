"""Looking through a dataset in a browser: an offline page for some episodes, a local server for
all."""

from .page import choose, viewer_server, write_viewer
