"""Named ways to draw."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """How to draw: a shader folder of ours or the name of a stock one, colour target, shadows.
    `samples` per pixel are edge samples of raster presets and paths of ray tracing; `edges` are
    smoothed afterwards."""

    shader: str
    target: str = "Image"
    shadow: bool = True
    samples: int = 1
    edges: bool = False

    @property
    def stock(self) -> bool:
        """Whether SAPIEN's own shaders are used: they divide light by pi and want linear
        colours."""
        return self.shader in ("default", "minimal", "rt")


PRESETS: dict[str, Preset] = {
    "raster": Preset("raster", edges=True),
    "raster-fast": Preset("raster", shadow=False),
    "raster-smooth": Preset("raster", samples=4),
    "rt": Preset("rt", "Color", samples=32),
    "sapien-default": Preset("default", "Color"),
    "sapien-minimal": Preset("minimal", "Color"),
}
