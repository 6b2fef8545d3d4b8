"""Types of the part of sapien.render that is used here."""

from typing import Any, Literal

from numpy.typing import ArrayLike, NDArray
from sapien import Component, Device, Entity, System

type FilterMode = Literal["nearest", "linear"]
type AddressMode = Literal["repeat", "border", "edge", "mirror"]

def set_msaa(msaa: int) -> None: ...
def set_picture_format(name: str, format: str) -> None: ...
def set_ray_tracing_samples_per_pixel(spp: int) -> None: ...
def set_ray_tracing_path_depth(depth: int) -> None: ...
def set_ray_tracing_denoiser(name: Literal["none", "oidn", "optix"]) -> None: ...
def get_device_summary() -> str: ...

class RenderSystem(System):
    def __init__(self, device: Device | str | None = ...) -> None: ...
    @property
    def device(self) -> Device: ...

class RenderTexture:
    def __init__(
        self,
        array: ArrayLike,
        dim: int,
        format: str,
        mipmap_levels: int = ...,
        filter_mode: FilterMode = ...,
        address_mode: AddressMode = ...,
        srgb: bool = ...,
    ) -> None: ...
    def upload(self, data: ArrayLike) -> None: ...

class RenderTexture2D:
    def __init__(
        self,
        array: ArrayLike,
        format: str,
        mipmap_levels: int = ...,
        filter_mode: FilterMode = ...,
        address_mode: AddressMode = ...,
        srgb: bool = ...,
    ) -> None: ...
    def upload(self, data: ArrayLike) -> None: ...

class RenderMaterial:
    base_color_texture: RenderTexture2D | None
    def __init__(
        self,
        emission: ArrayLike = ...,
        base_color: ArrayLike = ...,
        specular: float = ...,
        roughness: float = ...,
        metallic: float = ...,
        transmission: float = ...,
    ) -> None: ...

class RenderShape: ...

class RenderShapeTriangleMesh(RenderShape):
    def __init__(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        normals: ArrayLike,
        uvs: ArrayLike,
        material: RenderMaterial,
    ) -> None: ...

class RenderBodyComponent(Component):
    visibility: float
    shading_mode: int
    def __init__(self) -> None: ...
    def attach(self, shape: RenderShape) -> RenderBodyComponent: ...
    def clone(self) -> RenderBodyComponent: ...
    def set_property(self, name: str, value: float | ArrayLike) -> None: ...
    def set_texture(self, name: str, texture: RenderTexture | RenderTexture2D) -> None: ...

class RenderCameraComponent(Component):
    near: float
    far: float
    def __init__(self, width: int, height: int, shader_dir: str = ...) -> None: ...
    @property
    def entity(self) -> Entity: ...
    def set_fovy(self, fovy: float, compute_x: bool = ...) -> None: ...
    def set_property(self, name: str, value: float | ArrayLike) -> None: ...
    def set_texture(self, name: str, texture: RenderTexture | RenderTexture2D) -> None: ...
    def take_picture(self) -> None: ...
    def get_picture(self, name: str) -> NDArray[Any]: ...
