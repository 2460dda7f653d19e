"""What git says when it fails, with what a person can do about it in front."""

from __future__ import annotations

__all__ = ["explain"]

FULL = "the disk is full; nothing was changed"
EXPLAINED = (
    ("No space left on device", FULL),
    # Behind it fast-import guesses "disk corruption?".
    ("Out of diskspace", FULL),
    ("File too large", "a file may not grow that large here; nothing was changed"),
    ("Read-only file system", "the disk is read-only"),
    ("Permission denied", "access denied; wanted write access to the repository"),
    ("insufficient permission", "access denied; wanted write access to the repository"),
    (
        "dubious ownership",
        "it belongs to another user; git config --global --add safe.directory says you trust it",
    ),
)


def explain(told: str) -> str:
    """Give git's words, behind ours where ours help."""
    words = " ".join(line.strip() for line in told.splitlines() if line.strip()) or "no word of why"
    ours = [text for sign, text in EXPLAINED if sign.lower() in told.lower()]
    return f"{ours[0]} ({words})" if ours else words
