"""The files of a calibration: which are written for which verdict, and where."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.atomic import check_folder
from calibrary.calib.collect import Collected
from calibrary.calib.corners_file import encode_corners
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError
from calibrary.extras import PAGES, require
from calibrary.jobs.calibrate_board.page import calibration_page
from calibrary.pages import render_page

__all__ = ["Files", "Places"]


class Files(Struct, frozen=True, kw_only=True):
    """What is to be written.

    Attributes:
        content: bytes by path.
        held_back: what was asked for and is not written, since the calibration was refused.
        losses: what the format of the calibration has no place for.
    """

    content: dict[Path, bytes]
    held_back: tuple[Path, ...] = ()
    losses: tuple[str, ...] = ()


class Places(Struct, frozen=True, kw_only=True):
    """Paths of the outputs; None for those that are not wanted.

    Attributes:
        report: the page, .html.
        corners: what was seen, .json.
        out: K and distortion in some program's format.
        format: which format; None for the one that the suffix of ``out`` means.
    """

    report: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    format: str | None = None

    def check(self) -> None:
        """Find out before the work begins what would keep its result from being written.

        Raises:
            InputError: a folder may not be written to, a name is of another kind of file, or two are the same.
            MissingExtraError: a report is wanted, and what draws pages is not installed.
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

    def files(self, result: CalibrationResult, collected: Collected) -> Files:
        """Everything that the verdict allows: of a refused calibration its report and its corners.

        The corners are measurements, which no verdict on the camera makes worse: with more of them, or another lens
        model, they can be solved again.

        Raises:
            UnsupportedModelError: the format has no place for this lens.
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

    def _format(self) -> str:
        """The one that was named, or the one that is written under such a name."""
        written = [record for record in parsers.formats() if record.write is not None]
        if self.format is not None:
            if self.format not in {record.name for record in written}:
                names = ", ".join(record.name for record in written)
                raise InputError(
                    f"{self.format!r:.40} is not a format that is written; expected one of {names}",
                    place="--to",
                )
            return self.format
        return parsers.format_by_suffix(self.out or "", flag="--to").name
