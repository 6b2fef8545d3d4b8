"""Hashes of sources for tests that edit copies of them."""

from collections.abc import Callable
from pathlib import Path

from pipeline.run.identity import core


def hashing_once() -> Callable[[Path], str]:
    """`core.hash_file` that hashes each content once: to parse all sources takes a second, and all
    but the edited file of a copy are equal to others."""
    plain, hashes = core.hash_file.__wrapped__, dict[tuple[str, bytes], str]()

    def hash_file(path: Path) -> str:
        content = path.suffix, path.read_bytes()
        if content not in hashes:
            hashes[content] = plain(path)
        return hashes[content]

    hash_file.cache_clear = core.hash_file.cache_clear  # pyright: ignore[reportFunctionMemberAccess]
    return hash_file
