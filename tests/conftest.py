"""What all tests share: how hypothesis runs."""

from __future__ import annotations

from hypothesis import settings

# A machine busy with something else is no failure; examples that hang are caught by the suite's own time.
settings.register_profile("calibrary", deadline=None)
settings.load_profile("calibrary")
