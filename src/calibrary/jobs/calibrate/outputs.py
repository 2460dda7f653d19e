"""Files that a calibration writes, and which of them for which verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Generic, Protocol, Self, TypeAlias, TypeVar

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError, UnsupportedModelError, UsageError
from calibrary.pages import check_page_place, render_page
from calibrary.parsers.writing import why_unwritten
from calibrary.records import replace
from calibrary.validation import Use
from calibrary.view import View


class Judged(Protocol):
    """Result of a job that calibrates: a record that also has ``unwritten``."""

    @property
    def verdict(self) -> Use:
        """Verdict on the calibration."""


R = TypeVar("R", bound=Judged)
Encode: TypeAlias = Callable[[R, str], tuple[bytes, R]]
"""Makes the content of a file of this name, and the result with what the file's format cannot represent."""


class Outputs(Struct, Generic[R], frozen=True, kw_only=True):
    """Paths of the outputs; None for those not requested.

    Attributes:
        html: the page.
        corners: the detected corners: a file, or the folder of a rig's.
        out: the calibration in another program's format.
        encode: makes its content.
    """

    html: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    encode: Encode[R] | None = None

    @classmethod
    def of(
        cls,
        encoder: Callable[[str | None, Path], Encode[R]],
        *,
        html: str | Path | None = None,
        corners: Path | None = None,
        out: str | Path | None = None,
        to: str | None = None,
    ) -> Self:
        """Check before the work begins that the outputs can be written.

        Args:
            encoder: returns what writes a format, or that of the file's name.
            html: file of the page.
            corners: file or folder, checked.
            out: file of the calibration.
            to: its format.

        Raises:
            UsageError: there is a format, but no file of it, or the format cannot hold a calibration.
            InputError: a folder is not writable, no format fits a name, or two names are equal.
            MissingExtraError: a page is requested, but the libraries that draw pages are not installed.
        """
        if to is not None and out is None:
            raise UsageError("--to is the format of --out FILE, which is missing")
        page, file = check_page_place(html), file_to_write(out, "--out")
        encode = encoder(to, file) if file is not None else None
        wanted = [path for path in (page, corners, file) if path is not None]
        if len({path.resolve() for path in wanted}) < len(wanted):
            raise InputError("two outputs have one name; expected a file each", source=str(wanted[0].parent))
        return cls(html=page, corners=corners, out=file, encode=encode)

    def write(
        self, report: R, page: Callable[[R], View], corners: Callable[[Path], Mapping[Path, bytes]]
    ) -> R:
        """Write what the verdict permits: of a refused calibration only the page and the corners.

        The corners are measurements and stay valid if the calibration is refused: together with more of them,
        or with another lens model, they can be solved again.

        Args:
            report: result of the job.
            page: makes its page.
            corners: makes the files of the corners.

        Returns:
            The report, with why the calibration was not written, or with what its format cannot represent.

        Raises:
            InputError: a file cannot be written.
        """
        content: dict[Path, bytes] = {}
        if self.out is not None and self.encode is not None:
            try:
                if report.verdict is Use.NONE:
                    report = replace(report, unwritten="it is refused")
                else:
                    content[self.out], report = self.encode(report, self.out.name)
            except UnsupportedModelError as error:
                # The calibration may have taken minutes, and another format may hold it.
                report = replace(report, unwritten=why_unwritten(error))
        if self.html is not None:
            content[self.html] = render_page(page(report)).encode()
        if self.corners is not None:
            content |= corners(self.corners)
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
