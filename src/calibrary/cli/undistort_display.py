"""What ``calibrary undistort`` says of its work: lines for people, a document for machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from calibrary.calibration import ImageSize
    from calibrary.cli.undistort_work import Done, Written
    from calibrary.records import Json

__all__ = ["document", "show"]


def document(
    arguments: argparse.Namespace, done: Sequence[Done], cameras: Mapping[ImageSize, Written]
) -> dict[str, Json]:
    """What was done, as schemas/undistort-1.schema.json describes it."""
    from calibrary.records import to_json

    out: Path = arguments.out
    return {
        "schema": "calibrary/undistort-1",
        "calibration": arguments.calibration.name,
        "cameras": [
            {
                "file": camera.path.name,
                "format": arguments.to,
                "verdict": camera.verdict.outcome.value,
                "dropped": list(camera.verdict.dropped),
                "image_size": list(size),
                "calibration": to_json(camera.calibration),
                "kept": camera.plan.kept,
                "empty": camera.plan.empty,
                "notes": list(camera.notes),
            }
            for size, camera in cameras.items()
        ],
        "images": [
            {
                "file": one.job.image.name,
                "output": one.job.output.relative_to(out).as_posix() if one.error is None else None,
                "camera": cameras[one.size].path.name if one.size is not None else None,
                "warnings": list(one.warnings),
                "error": one.error,
            }
            for one in done
        ],
    }


def show(done: Sequence[Done], cameras: Mapping[ImageSize, Written], out: Path) -> None:
    """What was done, for people."""
    from calibrary.cli.console import make_console, plain

    console = make_console(stderr=False)
    for one in done:
        if one.error is not None:
            console.print(f"[red]not undistorted[/]: {plain(one.error)}", highlight=False, soft_wrap=True)
        for warning in one.warnings:
            line = f"[yellow]{plain(one.job.image.name)}: {plain(warning)}[/]"
            console.print(line, highlight=False, soft_wrap=True)
    made = sum(one.error is None for one in done)
    if not cameras:
        return
    lines = [f"undistorted {made} of {len(done)} images into {plain(str(out))}"]
    for size, camera in cameras.items():
        K, made_plan = camera.plan.intrinsics, camera.plan
        lines += [
            f"  {plain(camera.path.name)}  fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f}  in "
            f"{K.image_size[0]}×{K.image_size[1]} px, no distortion",
            f"    of {size[0]}×{size[1]} px images: {made_plan.kept:.1%} of the pixels are kept, "
            f"{made_plan.empty:.1%} of the new ones are empty",
            *(f"    note: {plain(note)}" for note in camera.notes),
        ]
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)
