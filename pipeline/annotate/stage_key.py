"""Keys of annotations: sha256 of canonical JSON."""

import hashlib
from collections.abc import Mapping
from typing import Any

from pipeline.data.errors import DominoError
from pipeline.data.keys import canonical

MOST_STRIDE = 600
"""Frames between the two images of a flow pair at most: ten seconds at the highest recording
rate."""

MOST_POINTS = 4096


class AnnotateError(DominoError): ...


def digest(value: Any) -> str:
    return hashlib.sha256(canonical(value)).hexdigest()


def annotation_key(
    stage: str, version: int, parameters: Mapping[str, Any], inputs: Mapping[str, Any]
) -> str:
    of_stage = {"stage": stage, "version": version, "parameters": dict(parameters)}
    return digest(of_stage | {"inputs": dict(inputs)})


def stage_key(stage: str, version: int, parameters: Mapping[str, Any]) -> str:
    """The first 8 hex digits of the key without its inputs."""
    return digest({"stage": stage, "version": version, "parameters": dict(parameters)})[:8]
