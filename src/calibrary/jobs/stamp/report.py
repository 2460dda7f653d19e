"""What stamping images reports, as one JSON document (schemas/stamp-1.schema.json)."""

from __future__ import annotations

from typing import Annotated, Literal

from calibrary.jobs.stamp.tags import TagSet
from calibrary.records import Meta, Record

__all__ = ["StampReport", "StampedImage"]


class StampedImage(Record):
    """One image.

    Attributes:
        file: its name.
        outcome: "refused" where the calibration is not of its camera or its tags cannot hold it, "unreadable" where
            the image cannot be read or is not a file that tags can be put into.
        output: path of the copy below the output folder; None where there is none.
        calibration: name of the file, or KEY of the entry, that it is stamped with.
        tags: that are written, by their names.
        max_error_px: by how much the copy's calibration projects differently, at most, anywhere in the image, as it
            was read back; 0 where every number is the same to 1e-12.
        notes: what to know of it.
        reason: against stamping it; None where it was.
    """

    file: str
    outcome: Literal["stamped", "refused", "unreadable"]
    output: str | None = None
    calibration: str | None = None
    tags: tuple[str, ...] = ()
    max_error_px: Annotated[float, Meta(ge=0)] | None = None
    notes: tuple[str, ...] = ()
    reason: str | None = None


class StampReport(Record, tag_field="schema", tag="calibrary/stamp-1"):
    """What ``calibrary stamp --json`` prints.

    Attributes:
        dry_run: whether nothing was written.
        tag_sets: that were asked for.
        images: in the order they were given.
    """

    dry_run: bool
    tag_sets: tuple[TagSet, ...]
    images: tuple[StampedImage, ...]
