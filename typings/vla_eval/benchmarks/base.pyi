from dataclasses import dataclass
from typing import Any

@dataclass
class StepResult:
    obs: Any
    reward: float
    done: bool
    info: dict[str, Any]

class StepBenchmark:
    _last_result: StepResult
    def __init__(self) -> None: ...
