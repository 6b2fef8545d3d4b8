class PlanFailure(Exception):
    """Planning found no solution. `reason` is a snake-case code for the attempts table, `detail` a
    line for people. The actor sets `skill`."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(reason, detail)
        self.reason, self.detail, self.skill = reason, detail, ""

    def __str__(self) -> str:
        return f"{self.reason}: {self.detail}" if self.detail else self.reason
