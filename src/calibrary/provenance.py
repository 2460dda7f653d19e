"""Where a calibration came from, and how good a K from there can be."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from calibrary.image_size import ImageSize
from calibrary.records import Meta, Record
from calibrary.records.limits import require_declared

__all__ = ["Grade", "Provenance", "SourceFile"]


class Grade(StrEnum):
    """How a K came about, best first. Only the first four may reach a solver as a K."""

    CALIBRATED = "calibrated"
    ADJUSTED = "adjusted"
    DESIGN = "design"
    DERIVED = "derived"
    PRIOR = "prior"
    SEED = "seed"

    @property
    def rank(self) -> int:
        """0 for the best grade, counting up."""
        return list(Grade).index(self)

    @property
    def is_metric(self) -> bool:
        """Whether a K of this grade may reach a solver as a K."""
        return self not in {Grade.PRIOR, Grade.SEED}

    @property
    def meaning(self) -> str:
        """Origin of such intrinsics, for the legend of a report."""
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
        name: without its folder.
        sha256: of its bytes, 64 hexadecimal digits.
    """

    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

    def __post_init__(self) -> None:
        require_declared(self)


class Provenance(Record):
    """Where a calibration came from.

    Attributes:
        kind: "image-metadata", "calibration-file", "matrix-file", "seed", "registry", …
        source: the file's name (no folder: a path tells about a disk, not about a camera).
        tag: the tag or key inside it.
        reference_size: the frame the source counts in, when it is not the image's own.
        adaptation: what brought it from there to the image's size, in words.
        assumptions: what had to be taken for granted.
        sha256: of the source's bytes, where it was a file of its own.
        sources: the files behind it, where it was made from several: the frames of a board.
        tool: the program that made it, with its version.
        date: when it was made, ISO 8601.
        operator: who made it.
        firmware: of the camera at that time, as it writes it.
        focus: how the lens was focused, in words: "locked at infinity", "1.5 m".
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
