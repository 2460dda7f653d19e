"""Early start of the processes that read images."""

from __future__ import annotations

__all__ = ["ready_to_read"]


def ready_to_read(workers: int) -> None:
    """Start the process that readers are forked from, while the command is still loading (saves half a second)."""
    if workers > 1:
        from calibrary.workers import get_ready

        get_ready(["calibrary.jobs.images.reading"])
