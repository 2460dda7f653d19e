"""Files that a calibration writes, and which of them for which verdict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol, Self, TypeVar

from msgspec import Struct

from calibrary import parsers
from calibrary.atomic import check_folder, write_files
from calibrary.calib.corners_file import encode_corners
from calibrary.calib.observations import Observations
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError, UnsupportedModelError, UsageError
from calibrary.pages import check_page_place, render_page
from calibrary.parsers.format import Format
from calibrary.parsers.writing import format_to_write, why_unwritten
from calibrary.records import replace
from calibrary.view import View


class Judged(Protocol):
    """Result of a job that calibrates: a record that also has ``unwritten`` and ``dropped``."""

    @property
    def verdict(self) -> BoardVerdict:
        """Verdict on the calibration."""

    @property
    def calibration(self) -> Calibration | None:
        """The calibration; None if there is none."""


R = TypeVar("R", bound=Judged)


class Outputs(Struct, frozen=True, kw_only=True):
    """Paths of the outputs; None for those not requested.

    Attributes:
        html: the page.
        corners: the detected corners, .json.
        out: K and distortion in another program's format.
        format: of ``out``.
    """

    html: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    format: Format | None = None

    @classmethod
    def of(
        cls,
        *,
        html: str | Path | None = None,
        corners: str | Path | None = None,
        out: str | Path | None = None,
        to: str | None = None,
    ) -> Self:
        """Check before the work begins that the outputs can be written.

        Raises:
            UsageError: there is a format, but no file of it, or the format has no place for a distortion.
            InputError: a folder is not writable, a name has the wrong suffix, or two names are equal.
            MissingExtraError: a page is requested, but the libraries that draw pages are not installed.
        """
        if to is not None and out is None:
            raise UsageError("--to is the format of --out FILE, which is missing")
        page, kept = check_page_place(html), file_to_write(corners, "--corners", ".json")
        file = file_to_write(out, "--out")
        record = format_to_write(to, file, flag="--to") if file is not None else None
        if record is not None and record.capacity is not None and not record.capacity.has_lens:
            raise UsageError(
                f"a {record.name} file has no place for the distortion that a calibration finds; expected another "
                "format, from which 'calibrary convert' makes such a file with --drop-distortion",
                source=str(file),
                place="--out",
            )
        wanted = [path for path in (page, kept, file) if path is not None]
        if len({path.resolve() for path in wanted}) < len(wanted):
            raise InputError("two outputs have one name; expected a file each", source=str(wanted[0].parent))
        return cls(
            html=page,
            corners=kept,
            out=file,
            format=record,
        )

    def write(self, report: R, page: Callable[[R], View], seen: Observations | None = None) -> R:
        """Write what the verdict permits: of a refused calibration only the page and the corners.

        The corners are measurements and stay valid if the calibration is refused: together with more of them,
        or with another lens model, they can be solved again.

        Args:
            report: result of the job.
            page: makes its page.
            seen: the corners.

        Returns:
            The report, with why the calibration was not written, or with what its format cannot represent.

        Raises:
            InputError: a file cannot be written.
        """
        content: dict[Path, bytes] = {}
        if self.out is not None and self.format is not None:
            if report.verdict is BoardVerdict.REFUSE or report.calibration is None:
                report = replace(report, unwritten="it is refused")
            else:
                try:
                    content[self.out], verdict = parsers.encode(
                        [report.calibration], self.format, name=self.out.name
                    )
                    report = replace(report, dropped=tuple(verdict.dropped))
                except UnsupportedModelError as error:
                    # The calibration may have taken minutes, and another format may hold it.
                    report = replace(report, unwritten=why_unwritten(error, "another format"))
        if self.html is not None:
            content[self.html] = render_page(page(report)).encode()
        if self.corners is not None and seen is not None:
            content[self.corners] = encode_corners(seen)
        write_files(content)
        return report


def file_to_write(path: str | Path | None, flag: str, *suffixes: str) -> Path | None:
    """Check that a file can be written at a path, and return it; None if there is no path.

    Raises:
        InputError: its folder is not writable, it is a folder, or its name has the wrong suffix.
    """
    if path is None:
        return None
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"expected a name that ends in {suffixes[0]}", source=str(path), place=flag)
    if path.is_dir():
        raise InputError("is a folder; expected a file's name", source=str(path), place=flag)
    check_folder(path, place=flag)
    return path
