"""The imperfections of a setup's cameras, as numbers: noise, motion blur, drift, errors of depth,
latency."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Sensors(BaseModel):
    """All off by default; world/drawing/sensing.py defines what each number does to a pixel."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    noise: Annotated[float, Field(ge=0, le=100)] = 0.0
    motion_blur: Annotated[float, Field(ge=0, le=200)] = 0.0
    drift: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    depth_noise: Literal["d435"] | None = None
    latency: Annotated[float, Field(ge=0, le=60)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _written(cls, value: Any) -> Any:
        """ "noise=2,latency=1" stands for {noise: 2, latency: 1}, and "none" for no
        imperfections."""
        if not isinstance(value, str):
            return value
        if value == "none":
            return {}
        pairs = [word.strip().split("=") for word in value.split(",")]
        if any(len(pair) != 2 for pair in pairs):
            raise ValueError("is not written as key=value, such as noise=2,motion_blur=8,latency=1")
        return {key.strip(): text.strip() for key, text in pairs}
