"""Common wording of the pages of a site."""

from __future__ import annotations

from calibrary.pages import Tone
from calibrary.pages.wording import made_by
from calibrary.registry.entry import Status
from calibrary.registry.git.history import Revision

__all__ = ["STATUSES", "made_at"]

STATUSES = {
    Status.APPROVED: Tone.GOOD,
    Status.HELD: Tone.GOOD,
    Status.DRAFT: Tone.CAUTION,
    Status.RETIRED: Tone.NEUTRAL,
}


def made_at(commit: Revision | None) -> str:
    """Footer with the commit that last changed the page's content, so that the page stays the same until the next."""
    return made_by(
        f"from commit {commit.commit[:12]} of {commit.committed:%Y-%m-%d}" if commit is not None else None
    )
