"""Files that hold the hash of what else they say, so that a changed value is found: JSON, and the
frozen recipe in YAML."""

import json
from collections.abc import Mapping
from typing import Any

import yaml

from pipeline.data.keys import digest

SEAL = "sha256"


def seal(values: Mapping[str, Any]) -> bytes:
    """Indented JSON of the values, keys sorted, with the hash of them under SEAL."""
    plain = {name: value for name, value in values.items() if name != SEAL}
    return json.dumps(plain | {SEAL: digest(plain)}, indent=2, sort_keys=True).encode()


def seal_yaml(text: str) -> bytes:
    """The YAML of a mapping of plain values, followed by the hash of them under SEAL."""
    return f"{text}{SEAL}: {digest(yaml.safe_load(text))}\n".encode()


def is_unchanged(values: Mapping[str, Any]) -> bool:
    """Whether values are those that were sealed."""
    return values.get(SEAL) == digest(
        {name: value for name, value in values.items() if name != SEAL}
    )
