"""The source of a calibration, and the grade of K that follows from it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from calibrary.image_size import ImageSize
from calibrary.records import Meta, Record
from calibrary.records.limits import require_declared

__all__ = ["Grade", "Provenance", "SourceFile"]


class Grade(StrEnum):
    """Origin of the intrinsics, best first. Only the first four may be used as a K by a solver."""

    CALIBRATED = "calibrated"
    ADJUSTED = "adjusted"
    DESIGN = "design"
    DERIVED = "derived"
    PRIOR = "prior"
    SEED = "seed"

    @property
    def rank(self) -> int:
        """0 for the best grade, increasing."""
        return list(Grade).index(self)

    @property
    def is_metric(self) -> bool:
        """Whether a solver may use intrinsics of this grade as a K."""
        return self not in {Grade.PRIOR, Grade.SEED}

    @property
    def meaning(self) -> str:
        """Explanation of the grade, for the legend of a report."""
        return GRADE_MEANINGS[self]


GRADE_MEANINGS = {
    Grade.CALIBRATED: "measured on this unit, with a calibration target or by the manufacturer",
    Grade.ADJUSTED: "estimated by the bundle adjustment of a reconstruction",
    Grade.DESIGN: "design value of the manufacturer for the camera model",
    Grade.DERIVED: "focal length divided by pixel pitch or sensor size",
    Grade.PRIOR: "from the 35 mm equivalent, or from a listed sensor width that nothing confirms",
    Grade.SEED: "generic start for a self-calibration",
}


class SourceFile(Record):
    """A file that a calibration was made from.

    Attributes:
        name: file name without the folder.
        sha256: SHA-256 of the content, 64 hexadecimal digits.
    """

    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

    def __post_init__(self) -> None:
        require_declared(self)


class Provenance(Record):
    """The source of a calibration.

    Attributes:
        kind: "image-metadata", "calibration-file", "matrix-file", "seed", "registry", …
        source: file name (without the folder, which says nothing about the camera).
        tag: tag or key inside the source.
        reference_size: (width, height) px that the source refers to, if it differs from the image's own size.
        adaptation: conversion from the reference size to the image size, in words.
        assumptions: assumptions that were made.
        sha256: SHA-256 of the source's content, if it was a separate file.
        sources: source files, if the calibration was made from several, such as the images of a board.
        tool: program that made the calibration, with its version.
        date: date of the calibration, ISO 8601.
        operator: person who made the calibration.
        firmware: firmware of the camera at that time, as the camera writes it.
        focus: focus setting of the lens, in words: "locked at infinity", "1.5 m".
    """

    kind: str
    source: str | None = None
    tag: str | None = None
    reference_size: ImageSize | None = None
    adaptation: str | None = None
    assumptions: tuple[str, ...] = ()
    sha256: str | None = None
    sources: tuple[SourceFile, ...] = ()
    tool: str | None = None
    date: str | None = None
    operator: str | None = None
    firmware: str | None = None
    focus: str | None = None
