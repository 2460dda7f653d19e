"""Tables of what real images say, each row made an image again and sent through the gate alone.

The facts of ``tags_of_real_images.csv`` are EXIF tags of public photographs of cameras, and fx in px by the
sensor widths that OpenSfM (BSD-2-Clause) and AliceVision (MPL-2.0) list for those cameras. No photograph and
no name of a file is in it. Rows in which the two databases differ by more than 3 %, and thumbnails, prove
nothing; a thermal image held against the width of the visible camera that shares its Model (M3T) is left out.
"""

from __future__ import annotations

import csv
import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from calibrary.jobs.extract.run import run
from calibrary.validation import Verdict
from tests.imagery import ExifTags, write_jpeg

TABLE = Path(__file__).with_name("tags_of_real_images.csv")
SMALLEST_SIDE = 500
"""px of the longer side; below it is a thumbnail."""

DATABASES_AGREE = 0.03
VALID_WITHIN, UNPROVEN_WITHIN, MOST_REJECTED = 0.03, 0.10, 0.05

Row = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Judged:
    """One row's outcome."""

    camera: str
    verdict: Verdict | None
    fx: float | None
    truth: float | None
    why: str

    @property
    def off(self) -> float:
        """How far fx is from the databases', as a share."""
        return abs(self.fx / self.truth - 1) if self.fx and self.truth else 0.0

    @property
    def half(self) -> int:
        """0 or 1, by make and model."""
        return hashlib.sha256(self.camera.split(" f ")[0].encode()).digest()[0] % 2

    def __str__(self) -> str:
        fx = f"{self.fx:.0f}" if self.fx else "none"
        return f"{self.camera}: fx {fx}, databases {self.truth or 0:.0f}: {self.why}"


def number(text: str | None) -> float | None:
    """A cell, None where it is empty or a word."""
    try:
        return float(text or "")
    except ValueError:
        return None


def truth(row: Row) -> float | None:
    """Fx by the databases' widths, None where there is none or they differ."""
    if max(int(row["file_w"]), int(row["file_h"])) < SMALLEST_SIDE:
        return None
    opensfm, alicevision = number(row["fx_by_opensfm_width"]), number(row["fx_by_alicevision_width"])
    if opensfm and alicevision and abs(opensfm / alicevision - 1) > DATABASES_AGREE:
        return None
    return opensfm or alicevision


def head(row: Row) -> ExifTags:
    """The row's tags as EXIF."""
    tags: dict[str, Any] = {name: row[name] for name in ("make", "model", "software", "lens") if row[name]}
    if "lens" in tags:
        tags["lens_model"] = tags.pop("lens").encode("ascii", "replace").decode()
    size = (number(row["exif_w"]), number(row["exif_h"]))
    if None not in size:
        tags["pixel_size"] = tuple(int(side or 0) for side in size)
    if orientation := number(row["orientation"]):
        tags["orientation"] = int(orientation)
    for name in ("focal_mm", "digital_zoom"):
        if value := number(row[name]):
            tags[name] = ratio(value)
    if value := number(row["focal_35mm"]):
        tags["focal_35mm"] = int(value)
    across, down = number(row["fp_x_res"]), number(row["fp_y_res"])
    if across and down:
        tags["focal_plane_resolution"] = (ratio(across), ratio(down))
        tags["focal_plane_unit"] = int(number(row["fp_unit"]) or 0) or None
    return ExifTags(**tags)


def ratio(value: float) -> tuple[int, int]:
    """As EXIF holds it."""
    exact = Fraction(value).limit_denominator(1000)
    return exact.numerator, exact.denominator


def judged(row: Row, folder: Path) -> Judged:
    """The row as an image of its own, through the gate."""
    image = folder / "a.jpg"
    write_jpeg(image, (int(row["file_w"]), int(row["file_h"])), exif=head(row))
    outcome = run(folder)
    camera = "{make} {model} f {focal_mm} ({focal_35mm}) {file_w}x{file_h}".format_map(row)
    if not outcome.judged:
        return Judged(camera, None, None, truth(row), outcome.rejected[0].reason)
    [one] = outcome.judged
    fx = one.calibration.intrinsics.fx if one.calibration is not None else None
    return Judged(camera, one.verdict, fx, truth(row), one.reason or "")


def read_table(path: Path) -> Iterator[Row]:
    """The rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        yield from csv.DictReader(file)


def all_judged(rows: Iterable[Row]) -> list[Judged]:
    """Every row's outcome."""
    with tempfile.TemporaryDirectory() as folder:
        return [judged(row, Path(folder)) for row in rows]


@dataclass(frozen=True, slots=True)
class Figures:
    """The three lists, and how many rows have a truth."""

    known: int
    wrong: tuple[Judged, ...]
    rejected: tuple[Judged, ...]
    far: tuple[Judged, ...]

    @property
    def are_met(self) -> bool:
        """Whether all three goals are."""
        return not self.wrong and not self.far and len(self.rejected) <= MOST_REJECTED * self.known

    def __str__(self) -> str:
        share = len(self.rejected) / max(1, self.known)
        return (
            f"of {self.known} with a truth: valid and more than 3 % wrong {len(self.wrong)}, right K's "
            f"rejected {len(self.rejected)} ({share:.0%}), unproven beyond 10 % {len(self.far)}"
        )


def figures(outcomes: Sequence[Judged]) -> Figures:
    """The three figures of some rows."""
    known = [one for one in outcomes if one.truth and one.verdict]
    return Figures(
        known=len(known),
        wrong=tuple(one for one in known if one.verdict is Verdict.VALID and one.off > VALID_WITHIN),
        rejected=tuple(one for one in known if one.verdict is Verdict.REJECTED),
        far=tuple(one for one in known if one.verdict is Verdict.UNPROVEN and one.off > UNPROVEN_WITHIN),
    )
