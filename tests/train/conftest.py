"""One small dataset for all trainings."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiongen.datasets import Dataset
from tests.train.runs import make_dataset


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("training"))


@pytest.fixture(scope="session")
def dataset(data: Path) -> Dataset:
    return Dataset.open(data)
