"""Frames of a board with EXIF, and files of corners, small enough to calibrate from in a test."""

from __future__ import annotations

from pathlib import Path

from calibrary.calib.corners_file import write_corners
from calibrary.records import replace
from tests.calib.photographs import SIZE, photograph
from tests.calib.solving import Session, shoot
from tests.imagery import ExifField, ExifTags, write_jpeg

MAKE, MODEL, FIRMWARE = "Example", "Board One", "01.02.0003"


def exif(
    make: str = MAKE,
    model: str = MODEL,
    *,
    focus_m: tuple[int, int] | None = (15, 10),
    firmware: str | None = FIRMWARE,
    date_time: str | None = None,
) -> ExifTags:
    """What the camera writes."""
    distance = (ExifField("SubjectDistance", (focus_m,)),) if focus_m is not None else ()
    return ExifTags(
        make=make,
        model=model,
        software=firmware,
        date_time=date_time,
        focal_mm=(48, 10),
        body_serial="A123",
        overrides=distance,
    )


def frames(folder: Path, count: int, tags: ExifTags | None = None, *, first: int = 0) -> list[Path]:
    """JPEGs of 640×480 px, each with the board held in another way."""
    return [
        write_jpeg(
            folder / f"frame_{number:02}.jpg",
            SIZE,
            exif=tags if tags is not None else exif(),
            pixels=photograph(number=number)[0],
            quality=92,
        )
        for number in range(first, first + count)
    ]


def corners(path: Path, seed: int = 2, how: Session | None = None, *, hashed: bool = True) -> Path:
    """A corners.json; without further wishes one that passes, and that names frames."""
    seen = shoot(how=how or Session(views=18), seed=seed)
    if hashed:
        views = [replace(view, sha256=f"{number:064x}") for number, view in enumerate(seen.views)]
        seen = replace(seen, views=tuple(views))
    write_corners(seen, path)
    return path


REFUSED = Session(views=18, tilt_deg=1)
PROVISIONAL = Session(views=9)
