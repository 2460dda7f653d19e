"""A registry that was just begun, as the registry's commands have it."""

from __future__ import annotations

import pytest

from calibrary.jobs.calibrate import page_plots
from calibrary.jobs.onboard import told
from calibrary.view import Figure
from tests.cli.registry.conftest import begun, fleet, nobodys_git

__all__ = ["begun", "fleet", "nobodys_git"]

UNDRAWN = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"></svg>'


@pytest.fixture(autouse=True)
def undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots take longer than all the rest; the tests of the page ask for ``drawn`` and get them."""
    if "drawn" in request.fixturenames:
        return
    figure = Figure(svg=UNDRAWN, alt="undrawn", caption="undrawn")
    monkeypatch.setattr(told, "intervals", lambda *_, **__: figure)
    monkeypatch.setattr(page_plots, "radial_curve", lambda *_, **__: figure)
    monkeypatch.setattr(page_plots, "distortion_map", lambda *_, **__: figure)


@pytest.fixture
def drawn() -> None:
    """The page with its plots."""
