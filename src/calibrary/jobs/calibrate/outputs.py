"""Output files of a calibration: paths, and which are written for which verdict."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.atomic import check_folder
from calibrary.calib.corners_file import encode_corners
from calibrary.calib.detection import Detections
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError
from calibrary.extras import PAGES, require
from calibrary.jobs.calibrate.page import calibration_page
from calibrary.pages import render_page
from calibrary.parsers.format import Format
from calibrary.parsers.writing import format_to_write

__all__ = ["Files", "Places"]


class Files(Struct, frozen=True, kw_only=True):
    """Files to be written.

    Attributes:
        content: bytes by path.
        held_back: requested files that are not written because the calibration was refused.
        losses: what the format of the calibration cannot represent.
    """

    content: dict[Path, bytes]
    held_back: tuple[Path, ...] = ()
    losses: tuple[str, ...] = ()


class Places(Struct, frozen=True, kw_only=True):
    """Paths of the outputs; None for those not requested.

    Attributes:
        report: the page, .html.
        corners: the detected corners, .json.
        out: K and distortion in another program's format.
        format: format of ``out``; None to choose by its suffix.
    """

    report: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    format: str | None = None

    def check(self) -> None:
        """Check before the work begins that the outputs can be written.

        Raises:
            InputError: a folder is not writable, a name has the wrong suffix, or two names are equal.
            MissingExtraError: a report is requested, but the libraries that draw pages are not installed.
        """
        if self.report is not None:
            require(PAGES, "a report")
        wanted = [*self._named()]
        for flag, path, suffixes in wanted:
            if suffixes and path.suffix.lower() not in suffixes:
                raise InputError(f"expected a name that ends in {suffixes[0]}", source=str(path), place=flag)
            if path.is_dir():
                raise InputError("is a folder; expected a file's name", source=str(path), place=flag)
            check_folder(path, place=flag)
        if len({path.resolve() for _, path, _ in wanted}) < len(wanted):
            raise InputError(
                "two outputs have one name; expected a file each", source=str(wanted[0][1].parent)
            )
        if self.out is not None:
            self._format()

    def files(self, result: CalibrationResult, collected: Detections) -> Files:
        """The files that the verdict permits; for a refused calibration only the report and the corners.

        The corners are measurements and stay valid if the calibration is refused: together with more of them,
        or with another lens model, they can be solved again.

        Raises:
            UnsupportedModelError: the format cannot represent this lens.
        """
        content: dict[Path, bytes] = {}
        if self.report is not None:
            content[self.report] = render_page(calibration_page(result, collected)).encode()
        if self.corners is not None:
            content[self.corners] = encode_corners(collected.observations)
        if result.verdict is BoardVerdict.REFUSE:
            return Files(content=content, held_back=(self.out,) if self.out is not None else ())
        losses: tuple[str, ...] = ()
        if self.out is not None:
            content[self.out], verdict = parsers.encode(
                [result.calibration], self._format(), name=self.out.name
            )
            losses = verdict.dropped
        return Files(content=content, losses=tuple(losses))

    def _named(self) -> Iterator[tuple[str, Path, tuple[str, ...]]]:
        if self.report is not None:
            yield "--report", self.report, (".html", ".htm")
        if self.corners is not None:
            yield "--corners", self.corners, (".json",)
        if self.out is not None:
            yield "--out", self.out, ()

    def _format(self) -> Format:
        """The stated format, or the one that belongs to the file name."""
        return format_to_write(self.format, self.out or "", flag="--to")
