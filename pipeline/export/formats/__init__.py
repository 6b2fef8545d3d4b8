"""Common formats, one module or folder a format."""
