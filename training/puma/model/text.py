"""From sentences to token ids: by the tokenizer of the weights, or by hashed words where there is
none."""

import re
import zlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Protocol

import torch
from torch import Tensor

PADDING = -1
"""Id of places behind the end of a sentence."""

BUCKET = 16
"""Lengths are rounded up to a multiple of this, so that few shapes occur."""


class Tokenizer(Protocol):
    """Turns sentences into ids."""

    def ids(self, texts: Sequence[str]) -> Tensor:
        """Ids (B,L) int64, PADDING behind the end of each sentence; L is a multiple of BUCKET."""
        ...


class HashedWords:
    """Every word, in lower case, is the CRC of its letters modulo `size - first`, plus `first`: a
    vocabulary without a file. `pieces`: so are every two words in a row, and every three letters of
    a word, by which words that were never seen have something in common with others."""

    def __init__(self, size: int, first: int = 0, pieces: bool = False) -> None:
        self._size, self._first, self._pieces = size, first, pieces

    def ids(self, texts: Sequence[str]) -> Tensor:
        """See Tokenizer."""
        span = self._size - self._first
        return padded(
            [[self._first + zlib.crc32(w.encode()) % span for w in self._parts(t)] for t in texts]
        )

    def _parts(self, text: str) -> list[str]:
        words = re.findall(r"\w+", text.lower())
        if not self._pieces:
            return words
        letters = [f"<{w}>"[i : i + 3] for w in words for i in range(len(w))]
        return [*words, *(f"{a} {b}" for a, b in pairwise(words)), *letters]


class TokenizedWords:
    """A tokenizer of transformers, without marks of its own."""

    def __init__(self, tokenizer: Any) -> None:
        self._tokenizer = tokenizer

    def ids(self, texts: Sequence[str]) -> Tensor:
        """See Tokenizer."""
        return padded(
            [self._tokenizer(text, add_special_tokens=False)["input_ids"] for text in texts]
        )


def padded(rows: Sequence[Sequence[int]]) -> Tensor:
    """Rows of ids as one tensor (B,L)."""
    longest = max(1, *(len(row) for row in rows))
    width = -(-longest // BUCKET) * BUCKET
    return torch.tensor([[*row, *[PADDING] * (width - len(row))] for row in rows])
