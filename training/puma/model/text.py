"""From sentences to token ids: by the tokenizer of the weights, or by hashed words where there is
none."""

import re
import zlib
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
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
        self._settings = size, first, pieces

    def ids(self, texts: Sequence[str]) -> Tensor:
        """See Tokenizer."""
        return padded([_hashed(text, *self._settings) for text in texts])


@lru_cache(1 << 17)  # sentences of demonstrations come again and again
def _hashed(text: str, size: int, first: int, pieces: bool) -> NDArray[np.int64]:
    words = re.findall(r"\w+", text.lower())
    if pieces:
        letters = [f"<{w}>"[i : i + 3] for w in words for i in range(len(w))]
        words = [*words, *(f"{a} {b}" for a, b in pairwise(words)), *letters]
    numbers = [first + zlib.crc32(word.encode()) % (size - first) for word in words]
    return np.array(numbers, np.int64)


class TokenizedWords:
    """A tokenizer of transformers, without marks of its own."""

    def __init__(self, tokenizer: Any) -> None:
        self._tokenizer = tokenizer

    def ids(self, texts: Sequence[str]) -> Tensor:
        """See Tokenizer."""
        return padded(
            [self._tokenizer(text, add_special_tokens=False)["input_ids"] for text in texts]
        )


def padded(rows: Sequence[ArrayLike]) -> Tensor:
    """Rows of ids as one tensor (B,L)."""
    lengths = [np.size(row) for row in rows]
    width = -(-max(1, *lengths) // BUCKET) * BUCKET
    out = np.full((len(rows), width), PADDING, np.int64)
    for ids, row, length in zip(out, rows, lengths, strict=True):
        ids[:length] = row
    return torch.from_numpy(out)
