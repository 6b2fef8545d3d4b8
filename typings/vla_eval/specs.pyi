from dataclasses import dataclass

@dataclass(frozen=True)
class DimSpec:
    name: str
    dims: int
    format: str
    range: tuple[float, float] | None = ...
    accepts: frozenset[str] | None = ...
    description: str = ...

IMAGE_RGB: DimSpec
LANGUAGE: DimSpec
