"""Frames of a board under a camera that is known exactly, to try a set-up before a board is printed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from calibrary.api.cameras import the_known_camera
from calibrary.calib.board import parse_board
from calibrary.calib.synthesis import Settings, Sheet, Shutter, Truth, poses
from calibrary.calib.synthesis.cameras import example_camera, head, unit_of
from calibrary.calib.synthesis.files import check_empty, write_frames
from calibrary.calibration import Calibration
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.exchange.reading import Reading, choose
from calibrary.known_camera import KnownCamera
from calibrary.progress import Progress

__all__ = ["render_frames"]


def render_frames(
    out: str | Path,
    board: str,
    *,
    square_mm: float,
    marker_mm: float | None = None,
    frames: int = 20,
    seed: int = 1,
    camera: str | None = None,
    calibration: str | Path | None = None,
    max_tilt_deg: float = 35.0,
    reach: float = 1.0,
    blur_px: float = 0.8,
    motion_px: float = 0.0,
    noise: float = 2.0,
    glare: float = 0.0,
    bow_mm: float = 0.0,
    stretch_pct: float = 0.0,
    readout_ms: float = 0.0,
    turn_deg_s: float = 0.0,
    quality: int = 92,
    progress: Progress | None = None,
) -> Truth:
    """Render frames of a board as a camera would have taken them, and the truth beside them: OUT/truth.json.

    Args:
        out: a new or an empty folder.
        board: which one, in inner corners, such as "checkerboard:11x8".
        square_mm: side of a square; of circles the distance of their centres.
        marker_mm: side of a marker, diameter of a circle.
        frames: how many.
        seed: the same seed gives the same frames.
        camera: a unit of a camera of the catalogue, by its Model or name; an example camera when not given.
        calibration: file of the calibration to photograph with, in place of ``camera``.
        max_tilt_deg: largest tilt of the board.
        reach: share of the image, about its middle, that is covered.
        blur_px: standard deviation of the blur.
        motion_px: motion along x while the shutter is open.
        noise: standard deviation of the noise, of 255.
        glare: of a lamp's mirror image; 1 saturates.
        bow_mm: how far the board's middle is behind its ends.
        stretch_pct: how much wider the print came out than asked for.
        readout_ms: of a rolling shutter, first to last row.
        turn_deg_s: how fast the camera turns to the side meanwhile.
        quality: of the JPEGs.
        progress: called with (frames done, frames in all, "frames").

    Raises:
        InputError: the folder is not empty, or there is no such board or camera.
        MissingExtraError: OpenCV is not installed.
    """
    require(CALIBRATE, "rendering frames")
    out = Path(out)
    check_empty(out)
    made = parse_board(board, square_mm, marker_mm)
    source, known = _camera(camera, calibration, seed)
    settings = Settings(
        sheet=Sheet.bowed(made, bow_mm, (1 + stretch_pct / 100, 1.0)),
        shutter=Shutter(readout_s=readout_ms / 1000, rate_deg_s=(0.0, turn_deg_s, 0.0)),
        blur_px=blur_px,
        motion_px=(motion_px, 0.0),
        noise=noise,
        glare=glare,
        quality=quality,
    )
    chosen = poses(made, source, frames, seed, max_tilt_deg=max_tilt_deg, reach=reach)
    truth = Truth(board=made, calibration=source, poses=chosen, settings=settings)
    counted = (lambda done: progress(done, len(chosen), "frames")) if progress is not None else None
    write_frames(out, truth, seed, partial(head, source, known), counted)
    return truth


def _camera(
    name: str | None, calibration: str | Path | None, seed: int
) -> tuple[Calibration, KnownCamera | None]:
    """The camera to photograph with, and what the catalogue says of its model."""
    if calibration is not None:
        path = Path(calibration)
        how = "'calibrary convert --camera N' and take its output"
        return choose(Reading().read(path), None, source=path.name, how=how), None
    if name is None:
        return example_camera(seed), None
    known = the_known_camera(name)
    return unit_of(known, seed), known
