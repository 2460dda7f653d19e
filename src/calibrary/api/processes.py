"""Processes that will read images, started while the command is still loading what comes after reading."""

from __future__ import annotations

from calibrary.workers import get_ready

__all__ = ["ready_to_read"]


def ready_to_read(workers: int) -> None:
    """Start what several processes are forked from, half a second before the first images are handed out."""
    if workers > 1:
        get_ready(["calibrary.jobs.images.reading"])
