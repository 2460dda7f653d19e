"""JSON document of a stamping (schemas/stamp-1.schema.json)."""

from __future__ import annotations

from typing import Annotated, Literal

from calibrary.jobs.stamp import TagSet
from calibrary.records import Meta, Record

__all__ = ["StampReport", "StampedImage"]


class StampedImage(Record):
    """One image.

    Attributes:
        file: file name.
        outcome: "refused" if the calibration does not belong to its camera or the tags cannot represent it,
            "unreadable" if the image cannot be read or is not a file that can contain the tags.
        output: path of the copy relative to the output folder; None if there is none.
        calibration: name of the file, or KEY of the entry, with the calibration.
        tags: names of the written tags.
        max_error_px: largest error of the projection anywhere in the image, from reading back the copy; 0 if
            all numbers are equal to 1e-12.
        notes: remarks.
        reason: why it was not stamped; None if it was.
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
    """Output of ``calibrary stamp --json``.

    Attributes:
        dry_run: whether nothing was written.
        tag_sets: the requested tag sets.
        images: in the given order.
    """

    dry_run: bool
    tag_sets: tuple[TagSet, ...]
    images: tuple[StampedImage, ...]

    @property
    def is_good(self) -> bool:
        """Whether every image was stamped."""
        return all(one.outcome == "stamped" for one in self.images)
