"""The base of every error that a user can cause."""


class DominoError(Exception):
    """Bad input or a damaged file. The message is one line that names the thing and the fix; the
    command ends with exit code 2."""
