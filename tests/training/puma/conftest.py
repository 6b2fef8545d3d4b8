"""One made-up dataset for all tests of this folder."""

from pathlib import Path

import pytest
import torch

from tests.training.puma.tiny import make_dataset


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Never change it: copy it first."""
    return make_dataset(
        tmp_path_factory.mktemp("data") / "bells", tmp_path_factory.mktemp("models")
    )


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")
