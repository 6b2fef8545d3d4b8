"""Imperfections of a setup's cameras (noise, blur, drift, latency) and of the drives of joints."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from .parsing import Strict


class _Imperfections(Strict):
    example: ClassVar[str]

    @model_validator(mode="before")
    @classmethod
    def _written(cls, value: Any) -> Any:
        """ "noise=2,latency=1" is {noise: 2, latency: 1}, "none" {}."""
        if not isinstance(value, str):
            return value
        pairs = [word.strip().split("=") for word in value.split(",")] if value != "none" else []
        if any(len(pair) != 2 for pair in pairs):
            raise ValueError(f"is not written as key=value, such as {cls.example}")
        return {key.strip(): text.strip() for key, text in pairs}


class Sensors(_Imperfections):
    """Imperfections of cameras; world/drawing/sensing.py defines each number."""

    example = "noise=2,motion_blur=8,latency=1"

    noise: Annotated[float, Field(ge=0, le=100)] = 0.0
    motion_blur: Annotated[float, Field(ge=0, le=200)] = 0.0
    drift: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    depth_noise: Literal["d435"] | None = None
    latency: Annotated[float, Field(ge=0, le=60)] = 0.0


class DriveErrors(_Imperfections):
    """How joints differ from their commands: `lag` (s) of all, `noise` (rad, standard deviation)
    and `backlash` (rad, whole play) of arms' joints."""

    example = "lag=0.03,noise=0.002,backlash=0.001"

    lag: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    noise: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    backlash: Annotated[float, Field(ge=0, le=0.1)] = 0.0

    @property
    def label(self) -> str:
        return f"drive-lag{self.lag:g}-noise{self.noise:g}-backlash{self.backlash:g}"
