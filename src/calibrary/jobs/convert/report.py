"""What converting reports: one file (schemas/convert-1.schema.json), or many (schemas/convert-files-1.schema.json)."""

from __future__ import annotations

from calibrary.parsers.format import Fidelity
from calibrary.provenance import Grade
from calibrary.records import Record

__all__ = ["ConvertFilesReport", "ConvertReport", "ConvertedFile"]


class ConvertReport(Record, tag_field="schema", tag="calibrary/convert-1"):
    """A file that was written from another.

    Attributes:
        output: name of the file.
        format: its format.
        verdict: how exactly it holds the calibration.
        rms_px: rms difference of the projections, of the worst camera.
        max_px: the largest difference.
        radius_px: distance from the principal point up to which the difference was measured.
        dropped: what the format has no place for.
        priors: the grades of the calibrations whose K was not measured.
        into: the cameras that were changed, where the file was there and has others.
        backup: name of the file that puts back what was there.
    """

    output: str
    format: str
    verdict: Fidelity
    rms_px: float
    max_px: float
    radius_px: float
    dropped: tuple[str, ...]
    priors: tuple[Grade, ...]
    into: tuple[int, ...]
    backup: str | None


class ConvertedFile(Record):
    """One of many files, or one camera of it.

    Attributes:
        source: name of the file before.
        camera: which of its cameras, from 1, where each has a file of its own.
        output: name of the file after; None where it was not written.
        verdict: how exactly it holds the calibration; None where it was not written.
        rms_px: rms difference of the projections, of the worst camera; None where it was not written.
        max_px: the largest difference.
        dropped: what the format has no place for.
        priors: the grades of the calibrations whose K was not measured.
        error: why it was not written; None where it was.
    """

    source: str
    camera: int | None
    output: str | None
    verdict: Fidelity | None
    rms_px: float | None
    max_px: float | None
    dropped: tuple[str, ...]
    priors: tuple[Grade, ...]
    error: str | None


class ConvertFilesReport(Record, tag_field="schema", tag="calibrary/convert-files-1"):
    """All files that were converted, and those that could not be.

    Attributes:
        files: in the order in which they were read.
    """

    files: tuple[ConvertedFile, ...]
