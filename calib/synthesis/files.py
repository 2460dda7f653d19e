"""A folder of synthetic images as a camera would write them, with the truth in a separate file."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import to_builtins

from calibrary.calib.board import Board
from calibrary.calib.synthesis.rendering import render_raw
from calibrary.calib.synthesis.truth import Truth
from calibrary.errors import InputError
from calibrary.records import Json, to_json
from calibrary.synthetic import Head, write_image

TRUTH_NAME: Final = "truth.json"


def check_empty(out: Path) -> None:
    """Check that the output folder is absent or empty.

    Raises:
        InputError: ``out`` is a file, or a folder that is not empty.
    """
    try:
        if out.is_dir():
            if next(out.iterdir(), None) is not None:
                raise InputError("is not empty; expected a new or an empty folder", source=str(out))
        elif out.exists():
            raise InputError("is a file; expected a new or an empty folder", source=str(out))
    except OSError as error:
        raise InputError(f"cannot be looked into: {error.strerror}", source=str(out)) from None


def write_frames(
    out: Path, truth: Truth, seed: int, head: Callable[[int], Head], done: Callable[[int], None] | None = None
) -> Path:
    """Render all poses, and write JPEGs and the truth; an incomplete run leaves no files.

    Args:
        out: a new or empty folder.
        truth: the scene and the settings.
        seed: seed of noise, backdrop and glare.
        head: metadata of an image by its number.
        done: called after each image with the number of images done.

    Returns:
        Path of the truth file.

    Raises:
        InputError: ``out`` is not empty or not writable, or the settings do not allow a JPEG.
    """
    check_empty(out)
    if truth.settings.quality is None:
        raise InputError("frames without a quality cannot be JPEGs; expected 1 … 95", place="quality")
    made = not out.exists()
    unfinished = out / ".unfinished"
    try:
        unfinished.mkdir(parents=True)
        frames = []
        for number in range(len(truth.poses)):
            frames.append(_write_frame(unfinished, truth, seed, head(number), number))
            if done is not None:
                done(number + 1)
        (unfinished / TRUTH_NAME).write_text(_document(truth, seed, frames), encoding="utf-8")
        # The truth is moved last: if it exists, all images do.
        for path in sorted(unfinished.iterdir(), key=lambda path: (path.name == TRUTH_NAME, path.name)):
            path.rename(out / path.name)
        unfinished.rmdir()
    except BaseException as error:
        shutil.rmtree(unfinished, ignore_errors=True)
        if made:
            with suppress(OSError):
                out.rmdir()
        if isinstance(error, OSError):
            raise InputError(f"cannot be written: {error.strerror or error}", source=str(out)) from None
        raise
    return out / TRUTH_NAME


def _write_frame(folder: Path, truth: Truth, seed: int, head: Head, number: int) -> Json:
    pose, settings = truth.poses[number], truth.settings
    pixels = render_raw(truth.board, truth.calibration, pose, settings, seed * 100_003 + number)
    path = write_image(
        folder / f"board_{number + 1:04}.jpg",
        pixels.astype(np.uint8, copy=False),
        head,
        quality=settings.quality or 0,
    )
    return {
        "name": path.name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "pose": {"rotation": list(pose.rotation), "translation_mm": list(pose.translation_mm)},
        "corners": [[float(x), float(y)] for x, y in truth.corners(number)],
    }


def _document(truth: Truth, seed: int, frames: list[Json]) -> str:
    document: dict[str, Json] = {
        "schema": "calibrary/truth-1",
        "tool": f"calibrary {version('calibrary')}",
        "seed": seed,
        "board": _board(truth.board),
        "settings": to_builtins(truth.settings),
        "calibration": to_json(truth.calibration),
        "frames": frames,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _board(board: Board) -> dict[str, Json]:
    return {
        "name": str(board),
        "square_mm": board.square_mm,
        "dictionary": board.dictionary,
        "marker_mm": board.marker_mm,
    }
