"""Output files of a calibrated rig: page, corners, and the rig in another program's format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import check_folder
from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError
from calibrary.jobs.calibrate.outputs import Files
from calibrary.jobs.calibrate_rig.page import rig_page
from calibrary.jobs.calibrate_rig.report import RigReport
from calibrary.jobs.calibrate_rig.run import RigCollected, corner_files
from calibrary.pages import render_page
from calibrary.parsers.rigs import RIG_FORMATS, encode_rig, format_of_name

__all__ = ["RigPlaces"]


class RigPlaces(Struct, frozen=True, kw_only=True):
    """Paths of the outputs; None for those not requested.

    Attributes:
        report: the page, .html.
        corners: folder for the corners: rig.json and a corner file for each camera.
        out: the rig in another program's format.
        format: format of ``out``; None to choose by its name.
    """

    report: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    format: str | None = None

    def check(self) -> None:
        """Check before the work begins that the outputs can be written.

        Raises:
            InputError: a folder is not writable, a name has the wrong suffix, or the format is unknown.
        """
        for flag, path in self._named():
            if path.is_dir():
                raise InputError("is a folder; expected a file's name", source=str(path), place=flag)
            check_folder(path, place=flag)
        if self.report is not None and self.report.suffix.lower() not in {".html", ".htm"}:
            raise InputError("expected a name that ends in .html", source=str(self.report), place="--report")
        if self.corners is not None:
            if self.corners.exists() and not self.corners.is_dir():
                raise InputError("is a file; expected a folder", source=str(self.corners), place="--corners")
            check_folder(self.corners, place="--corners")
        if self.out is not None:
            self._format(self.out)

    def files(self, result: RigResult, collected: RigCollected, report: RigReport) -> Files:
        """The files that the verdict permits; for a refused rig only the report and the corners.

        Raises:
            UnsupportedModelError: the format cannot represent these cameras.
        """
        content: dict[Path, bytes] = {}
        if self.report is not None:
            content[self.report] = render_page(rig_page(result, collected, report)).encode()
        if self.corners is not None:
            content |= {self.corners / name: data for name, data in corner_files(collected).items()}
        if self.out is not None and result.verdict is BoardVerdict.REFUSE:
            return Files(content=content, held_back=(self.out,))
        if self.out is not None:
            content[self.out] = encode_rig(result.rig, self._format(self.out), self.out.name)
        return Files(content=content)

    def _named(self) -> Iterator[tuple[str, Path]]:
        if self.report is not None:
            yield "--report", self.report
        if self.out is not None:
            yield "--out", self.out

    def _format(self, out: Path) -> str:
        if self.format is None:
            return format_of_name(out.name)
        if self.format not in RIG_FORMATS:
            raise InputError(
                f"{self.format!r:.40} is not a rig format; expected one of {', '.join(RIG_FORMATS)}",
                place="--to",
            )
        return self.format
