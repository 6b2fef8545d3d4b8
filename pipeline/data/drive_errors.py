"""How a robot's joints differ from what is commanded, as numbers: lag, noise and backlash."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator


class DriveErrors(BaseModel):
    """All off by default; world/physics/imperfect.py defines what each number does.

    `lag` (s), rounded to physics steps, is for all joints and grippers; `noise` (rad, standard
    deviation) and `backlash` (rad, from one side of the play to the other) are for joints of arms.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    lag: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    noise: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    backlash: Annotated[float, Field(ge=0, le=0.1)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _written(cls, value: Any) -> Any:
        """ "lag=0.03,noise=0.002" stands for {lag: 0.03, noise: 0.002}, "none" for no errors."""
        if not isinstance(value, str):
            return value
        if value == "none":
            return {}
        pairs = [word.strip().split("=") for word in value.split(",")]
        if any(len(pair) != 2 for pair in pairs):
            raise ValueError(
                "is not written as key=value, such as lag=0.03,noise=0.002,backlash=0.001"
            )
        return {key.strip(): text.strip() for key, text in pairs}

    @property
    def label(self) -> str:
        """A word for paths and tables."""
        return f"drive-lag{self.lag:g}-noise{self.noise:g}-backlash{self.backlash:g}"
