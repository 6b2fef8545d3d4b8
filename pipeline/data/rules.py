"""By which rules an episode is made and judged: ours, or those of the benchmark DOMINO."""

from dataclasses import dataclass
from typing import Literal

from pipeline.data.meta import Category

RuleSet = Literal["strict", "domino"]
Contact = Literal["stop", "continue"]


@dataclass(frozen=True)
class Rules:
    """`name`: "strict" are ours, "domino" the sizes, tolerances and conditions of the original's dynamic tasks.

    `contact` says what the first touch does to the target of a tracking task: "stop" ends its own motion (the paper's text),
    "continue" lets it follow its motion through the contact (the original's evaluation). Without it, strict rules stop the target
    and domino rules let it go on. The target of an interception task always stops, since a gripper holds it.
    """

    name: RuleSet = "strict"
    contact: Contact | None = None

    def stops(self, category: Category) -> bool:
        """Whether the first touch ends the target's own motion."""
        if category == "interception":
            return True
        return (self.contact or ("stop" if self.name == "strict" else "continue")) == "stop"

    @property
    def label(self) -> str:
        """A word for paths and tables: "strict", "domino", "strict-continue" and so on."""
        return self.name if self.contact is None else f"{self.name}-{self.contact}"


STRICT = Rules()
