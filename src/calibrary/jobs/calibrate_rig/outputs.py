"""Files that a calibration of a rig writes: page, corners, and the rig in another program's format."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Self

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.calib.corners_file import encode_corners
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError, UnsupportedModelError, UsageError
from calibrary.jobs.calibrate.outputs import file_to_write
from calibrary.jobs.calibrate_rig.report import RigReport
from calibrary.jobs.calibrate_rig.run import CORNERS_NAME, RigCorners, RigDetections
from calibrary.jobs.calibrate_rig.told import told
from calibrary.pages import check_page_place, render_page
from calibrary.parsers.rigs import encode_rig, format_of_name
from calibrary.parsers.writing import why_unwritten
from calibrary.records import replace, to_json


class RigOutputs(Struct, frozen=True, kw_only=True):
    """Paths of the outputs; None for those not requested.

    Attributes:
        html: the page.
        corners: folder for the corners.
        out: the rig in another program's format.
        format: of ``out``.
    """

    html: Path | None = None
    corners: Path | None = None
    out: Path | None = None
    format: str | None = None

    @classmethod
    def of(
        cls, *, html: str | Path | None, corners: str | Path | None, out: str | Path | None, to: str | None
    ) -> Self:
        """Check before the work begins that the outputs can be written.

        Raises:
            UsageError: there is a format, but no file of it.
            InputError: a folder is not writable, a name has the wrong suffix, or no format fits it.
            MissingExtraError: a page is requested, but the libraries that draw pages are not installed.
        """
        if to is not None and out is None:
            raise UsageError("--to is the format of --out FILE, which is missing")
        folder = Path(corners) if corners is not None else None
        if folder is not None:
            if folder.exists() and not folder.is_dir():
                raise InputError("is a file; expected a folder", source=str(folder), place="--corners")
            check_folder(folder, place="--corners")
        file = file_to_write(out, "--out")
        return cls(
            html=check_page_place(html),
            corners=folder,
            out=file,
            format=to or (format_of_name(file.name) if file is not None else None),
        )

    def write(self, report: RigReport, detections: RigDetections) -> RigReport:
        """Write what the verdict permits: for a refused rig only the page and the corners.

        Returns:
            The report, with why the rig was not written.

        Raises:
            InputError: a file cannot be written.
        """
        content: dict[Path, bytes] = {}
        if self.out is not None and self.format is not None:
            if report.verdict is BoardVerdict.REFUSE:
                report = replace(report, unwritten="it is refused")
            else:
                try:
                    content[self.out] = encode_rig(report.rig, self.format, self.out.name)
                except UnsupportedModelError as error:
                    report = replace(report, unwritten=why_unwritten(error))
        if self.html is not None:
            content[self.html] = render_page(told(report)).encode()
        if self.corners is not None:
            content |= {self.corners / name: data for name, data in corner_files(detections).items()}
        write_files(content)
        return report


def corner_files(detections: RigDetections) -> dict[str, bytes]:
    """Content of rig.json and of the corner files, by file name."""
    names = {name: f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)}.corners.json" for name in detections.cameras}
    kept = RigCorners(cameras=names, shots=detections.shots)
    files = {names[name]: encode_corners(one.observations) for name, one in detections.cameras.items()}
    return {CORNERS_NAME: (json.dumps(to_json(kept), indent=1, ensure_ascii=False) + "\n").encode(), **files}
