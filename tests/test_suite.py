"""The suite itself: tests that share what is costly to make stay together on one worker."""

from __future__ import annotations

import pytest


@pytest.mark.xdist_group("suite")
def test_groups_are_kept_together(request: pytest.FixtureRequest) -> None:
    if not request.config.getoption("loadgroup", False):
        pytest.skip("the tests run on one worker, or on several without groups; `make test` has groups")
    assert request.node.nodeid.endswith("@suite"), "pytest and pytest-xdist do not fit together; take the pinned ones"
