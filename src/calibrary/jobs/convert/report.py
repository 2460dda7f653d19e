"""JSON document of a conversion (schemas/convert-2.schema.json)."""

from __future__ import annotations

from calibrary.parsers.format import Fidelity, in_words
from calibrary.provenance import Grade
from calibrary.records import Record

__all__ = ["ConvertReport", "ConvertedFile"]


class ConvertedFile(Record):
    """One file that was written, or could not be.

    Attributes:
        source: name of the source file.
        camera: number of the camera in the source, from 1, if each camera gets its own file.
        output: name of the written file; None if it was not written.
        format: its format.
        verdict: how exactly it represents the calibration; None if it was not written, as the numbers below.
        rms_px: RMS difference of the projections, for the worst camera.
        max_px: largest difference of the projections.
        radius_px: distance from the principal point up to which the difference was measured; None for the whole image.
        lost_px: how far the distortion that the file lacks moves pixels, at most.
        dropped: what the format cannot represent.
        priors: grades of the calibrations with a K that was not measured.
        into: the changed cameras, if the output is an existing file with several cameras.
        backup: name of the file that restores the previous content.
        error: reason why it was not written; None if it was.
    """

    source: str
    format: str
    camera: int | None = None
    output: str | None = None
    verdict: Fidelity | None = None
    rms_px: float | None = None
    max_px: float | None = None
    radius_px: float | None = None
    lost_px: float | None = None
    dropped: tuple[str, ...] = ()
    priors: tuple[Grade, ...] = ()
    into: tuple[int, ...] = ()
    backup: str | None = None
    error: str | None = None

    def __str__(self) -> str:
        if self.verdict is None:
            return f"refused: {self.error}"
        return in_words(
            self.verdict,
            self.rms_px or 0.0,
            self.max_px or 0.0,
            self.radius_px,
            self.dropped,
            self.lost_px or 0.0,
        )


class ConvertReport(Record, tag_field="schema", tag="calibrary/convert-2"):
    """All converted files, and those that could not be converted.

    Attributes:
        files: in reading order.
    """

    files: tuple[ConvertedFile, ...]

    @property
    def is_good(self) -> bool:
        """Whether there is a file and every file was written."""
        return bool(self.files) and all(one.error is None for one in self.files)
