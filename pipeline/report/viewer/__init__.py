"""A dataset in a browser: an offline page or a local server."""

from .page import choose, viewer_server, write_viewer
