"""Why an attempt was not accepted."""


class Failure(Exception):
    """An attempt that ends without an episode: the stage it reached, a reason code in snake case, the physics steps it took."""

    def __init__(self, stage: str, reason: str, detail: str = "") -> None:
        super().__init__(f"{stage}: {reason}" + (f" ({detail})" if detail else ""))
        self.stage, self.reason, self.detail, self.steps = stage, reason, detail, 0
