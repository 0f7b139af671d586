"""One small dataset, and one recogniser that was really trained on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiongen.datasets import Dataset
from motiongen.recognition import Recogniser
from tests.recognition.kinds import make_dataset, trained


@pytest.fixture(scope="session")
def kinds_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("kinds"))


@pytest.fixture(scope="session")
def kinds(kinds_data: Path) -> Dataset:
    return Dataset.open(kinds_data)


@pytest.fixture(scope="session")
def recogniser(kinds: Dataset) -> Recogniser:
    return trained(kinds)
