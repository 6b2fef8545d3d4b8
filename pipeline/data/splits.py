"""Which split an episode belongs to: a function of its physics alone, so that no build, render or
export can change it."""

import hashlib

VALIDATION, TEST = 0.1, 0.1
"""Shares of physics episodes in the splits "validation" and "test", in the order in which positions
from 0 are dealt out."""


def position_of(physics_id: str) -> float:
    """A number in [0, 1) for a physics episode: the first 8 bytes of the SHA-256 of its id,
    big-endian, over 2**64."""
    return int.from_bytes(hashlib.sha256(physics_id.encode()).digest()[:8]) / 2**64


def split_of(physics_id: str, validation: float = VALIDATION) -> str:
    """ "train", "validation" or "test"; `validation` is the share of that one.

    All looks of one physics episode are in the same split."""
    position = position_of(physics_id)
    return (
        "validation"
        if position < validation
        else "test"
        if position < validation + TEST
        else "train"
    )
