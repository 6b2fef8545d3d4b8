"""What a check of a contract found."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One clause of a contract: whether it holds, and what was seen."""

    name: str
    ok: bool
    detail: str
