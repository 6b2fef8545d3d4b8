"""What an examination found."""

from dataclasses import asdict, dataclass
from typing import Literal

Verdict = Literal["PASS", "WARN", "FAIL"]


@dataclass(frozen=True)
class Result:
    """`verdict` FAIL: nothing can be built; WARN: something that not everybody needs does not work. `fix` says how to mend it."""

    name: str
    verdict: Verdict
    detail: str
    fix: str = ""

    def as_dict(self) -> dict[str, str]:
        """Plain data, for JSON."""
        return asdict(self)
