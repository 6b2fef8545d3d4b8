"""Foreign messages as one printable line."""

from pipeline.data.reading import printable


def line_of(error: BaseException) -> str:
    """Type and message of an error that foreign code raised."""
    if isinstance(error, SystemExit):
        code = error.code if isinstance(error.code, str) else f"exit code {error.code or 0}"
        return line_of_text(f"the process ended by itself: {code}")
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 (its __str__ is foreign code too)
        text = ""
    return line_of_text(f"{type(error).__name__}: {text}")


def line_of_text(text: object) -> str:
    """A text in one printable line of at most 500 characters."""
    return printable(" ".join(str(text)[:5000].split())[:500])
