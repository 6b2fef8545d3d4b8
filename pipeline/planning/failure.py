from typing import TYPE_CHECKING

from pipeline.poses import Floats

if TYPE_CHECKING:
    pass


class PlanFailure(Exception):
    """Planning found no solution. `reason` is a snake-case code for the attempts table, `detail` a
    line for people.

    `arm` (an ArmPlanner) was to bring its tcp to one of the world poses `wanted` (N,7), if the
    failure is about poses. The actor sets `skill`."""

    def __init__(
        self, reason: str, detail: str = "", arm: object = None, wanted: "Floats | None" = None
    ) -> None:
        super().__init__(reason, detail)
        self.reason, self.detail, self.arm, self.wanted = reason, detail, arm, wanted
        self.skill = ""

    def __str__(self) -> str:
        return f"{self.reason}: {self.detail}" if self.detail else self.reason
