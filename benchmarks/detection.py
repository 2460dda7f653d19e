"""How fast and how well corners are found in 20-megapixel frames, beside the script everybody copies.

    python -m benchmarks.detection [--frames N] [--megapixels M]

Renders frames of a checkerboard with sensor noise, saves them as JPEG of 7 to 8 MB and measures, on one core:

* calibrary: read, hash, decode, find, measure and judge; CPU seconds a frame;
* the usual script in the same run: decode, ``findChessboardCorners`` at full size, ``cornerSubPix`` with a window
  of (11, 11);
* what an expert writes: OpenCV's sector-based detector on a quarter of the frame's width, then ``cornerSubPix`` on
  all of it; on pixels alone, with decoding, and on a frame that shows no board;
* how far the corners of both lie from the truth.

CPU time is compared, not the clock's, so that what else the machine does is left out. Nothing here fails on a slow
machine; a goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.table import at_least, compared, in_turns
from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import detect, detect_all
from calibrary.calib.found import NotFound
from calibrary.calib.frames import read_frame
from calibrary.calib.synthesis import Settings, poses, render_raw, seen_corners
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady

Answer = TypeVar("Answer")

BOARD = Board(columns=11, rows=8, square_mm=40.0)
NOISY = Settings(noise=5.0)
QUALITY = 95

FRAMES_A_SECOND = 4.0
TIMES_FASTER = 30.0
TIMES_REDUCED = 0.9
REDUCTION = 4
TURNS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What was measured, on one core.

    Attributes:
        frames: how many were read.
        file_mb: their mean size.
        seconds: CPU time a frame.
        naive_seconds: the usual script's.
        beside_reduced: CPU times beside the expert's script, ours and its, by what is done.
        sd_px, naive_sd_px: standard deviation of the corners' x and y from the truth.
    """

    frames: int
    file_mb: float
    seconds: float
    naive_seconds: float
    beside_reduced: dict[str, tuple[list[float], list[float]]]
    sd_px: float
    naive_sd_px: float

    def show(self) -> None:
        """Print the rows."""
        at_least("frames a second and core, end to end", 1 / self.seconds, "/s", FRAMES_A_SECOND)
        own, naive, script = [self.seconds], [self.naive_seconds], "the usual script"
        compared("a frame", own, naive, scale=1, unit="s", name=script, least=TIMES_FASTER)
        for what, times in self.beside_reduced.items():
            compared(what, *times, scale=1, unit="s", name="reduced cv2 + subpix", most=TIMES_REDUCED)
        compared("corner noise", [self.sd_px], [self.naive_sd_px], scale=1, unit="px", name=script)


def survey_camera(megapixels: float) -> Calibration:
    """A 3:2 survey camera of 8.8 mm, of any number of pixels."""
    height = round((megapixels * 1e6 / 1.5) ** 0.5)
    size = round(1.5 * height), height
    fx = 0.6723 * size[0]
    return Calibration(
        camera=CameraKey(make="Example", model="Survey", image_size=size),
        intrinsics=Intrinsics(fx=fx, fy=0.998 * fx, cx=size[0] / 2 + 8, cy=size[1] / 2 - 5, image_size=size),
        distortion=BrownConrady(k1=-0.2687, k2=0.1147, p1=1.5e-5, p2=-4.7e-5, k3=-0.035),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthesis"),
    )


def measure(folder: Path, *, frames: int = 4, megapixels: float = 20.0) -> Figures:
    """Write frames into ``folder`` and time everything on them."""
    cv2.setNumThreads(1)
    camera = survey_camera(megapixels)
    held = poses(BOARD, camera, frames, 3)
    paths, truths = [], []
    for number, pose in enumerate(held):
        paths.append(folder / f"frame_{number:02}.jpg")
        _write(paths[-1], np.asarray(render_raw(BOARD, camera, pose, NOISY, number)))
        truths.append(seen_corners(BOARD, camera, pose, NOISY.sheet, NOISY.shutter))
    _write(folder / "empty.jpg", _without_board(paths[0]))

    detect(read_frame(paths[0]).gray, BOARD)
    seconds, collected = _timed(lambda: detect_all(paths, BOARD, workers=1))
    views = collected.observations.views
    assert len(views) == frames, [str(entry) for entry in collected.rejected]
    errors = [view.image_points - truth[view.ids] for view, truth in zip(views, truths, strict=True)]
    naive_seconds, naive = _timed(lambda: _usual_script(paths[0]))
    gray, empty = (read_frame(path).gray for path in (paths[0], folder / "empty.jpg"))
    assert isinstance(detect(empty, BOARD), NotFound)
    turned = min((naive, naive[::-1]), key=lambda corners: float(np.abs(corners - truths[0]).max()))
    return Figures(
        frames=frames,
        file_mb=float(np.mean([path.stat().st_size for path in paths])) / 1e6,
        seconds=seconds / frames,
        naive_seconds=naive_seconds,
        beside_reduced={
            "corners of a decoded frame": _beside(lambda: detect(gray, BOARD), lambda: _reduced(gray)),
            "corners of a file": _beside(
                lambda: detect_all(paths[:1], BOARD, workers=1), lambda: _reduced(_decoded(paths[0]))
            ),
            "a decoded frame without a board": _beside(lambda: detect(empty, BOARD), lambda: _reduced(empty)),
        },
        sd_px=float(np.std(np.concatenate(errors))),
        naive_sd_px=float(np.std(turned - truths[0])),
    )


def _usual_script(path: Path) -> FloatArray:
    """As tutorials have it; its corners in the canonical origin."""
    colour = cv2.imread(str(path))
    assert colour is not None
    gray = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    found, corners = cv2.findChessboardCorners(gray, (BOARD.columns, BOARD.rows), None)
    assert found
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
    refined = cv2.cornerSubPix(gray, corners.reshape(-1, 1, 2), (11, 11), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2) + 0.5


def _beside(ours: Callable[[], object], theirs: Callable[[], object]) -> tuple[list[float], list[float]]:
    """CPU seconds of both, in turns."""
    costs = in_turns({"ours": ours, "theirs": theirs}, TURNS)
    return [cost.cpu_s for cost in costs["ours"]], [cost.cpu_s for cost in costs["theirs"]]


def _decoded(path: Path) -> NDArray[np.uint8]:
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert gray is not None
    return np.asarray(gray, dtype=np.uint8)


def _reduced(gray: NDArray[np.uint8]) -> object:
    """Find the board in a small copy, and refine its corners in the frame."""
    share = 1 / REDUCTION
    small = cv2.resize(gray, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCornersSB(small, (BOARD.columns, BOARD.rows))
    if not found:
        return None
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
    rough = ((corners + 0.5) * REDUCTION - 0.5).astype(np.float32)
    return cv2.cornerSubPix(gray, rough, (11, 11), (-1, -1), criteria)


def _without_board(path: Path) -> NDArray[np.uint8]:
    """What stands behind the board, over all of the frame: the upper left quarter, enlarged, with noise of its own."""
    gray = read_frame(path).gray
    height, width = gray.shape
    enlarged = cv2.resize(gray[: height // 5, : width // 5], (width, height), interpolation=cv2.INTER_CUBIC)
    noise = np.random.default_rng(9).normal(0, 5, (height, width))
    return np.clip(enlarged + noise, 0, 255).astype(np.uint8)


def _write(path: Path, pixels: NDArray[np.uint8]) -> None:
    assert cv2.imwrite(str(path), pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def _timed(work: Callable[[], Answer]) -> tuple[float, Answer]:
    """CPU seconds, and what came of it."""
    start = time.process_time()
    answer = work()
    return time.process_time() - start, answer


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--megapixels", type=float, default=20.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(Path(folder), frames=arguments.frames, megapixels=arguments.megapixels)
    print(
        f"{figures.frames} frames of {arguments.megapixels:g} MP, {figures.file_mb:.1f} MB each; "
        f"OpenCV {cv2.__version__}"
    )
    figures.show()


if __name__ == "__main__":
    main()
