"""What tests of the server share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture
def forgotten_pages() -> Iterator[None]:
    """Nobody comes or goes any more when a test is over, and who was there is forgotten."""
    yield
    from tests.web.pages import forget_pages

    forget_pages()
