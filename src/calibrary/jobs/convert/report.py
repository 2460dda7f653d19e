"""JSON documents of a conversion: one file (schemas/convert-1.schema.json) or many (convert-files-1)."""

from __future__ import annotations

from calibrary.parsers.format import Fidelity
from calibrary.provenance import Grade
from calibrary.records import Record

__all__ = ["ConvertFilesReport", "ConvertReport", "ConvertedFile"]


class ConvertReport(Record, tag_field="schema", tag="calibrary/convert-1"):
    """A converted file.

    Attributes:
        output: name of the file.
        format: its format.
        verdict: how exactly it represents the calibration.
        rms_px: RMS difference of the projections, for the worst camera.
        max_px: largest difference of the projections.
        radius_px: distance from the principal point up to which the difference was measured.
        dropped: what the format cannot represent.
        priors: grades of the calibrations with a K that was not measured.
        into: the changed cameras, if the output is an existing file with several cameras.
        backup: name of the file that restores the previous content.
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
    """One of many files, or one camera of a file.

    Attributes:
        source: name of the source file.
        camera: number of the camera in the source, from 1, if each camera gets its own file.
        output: name of the written file; None if it was not written.
        verdict: how exactly it represents the calibration; None if it was not written.
        rms_px: RMS difference of the projections, for the worst camera; None if it was not written.
        max_px: largest difference of the projections.
        dropped: what the format cannot represent.
        priors: grades of the calibrations with a K that was not measured.
        error: reason why it was not written; None if it was.
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
    """All converted files, and those that could not be converted.

    Attributes:
        files: in reading order.
    """

    files: tuple[ConvertedFile, ...]
