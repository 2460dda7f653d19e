"""What ``calibrary undistort`` says of its work: lines for people, a document for machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from calibrary.calibration import ImageSize
    from calibrary.cli.console import Screen
    from calibrary.cli.undistort_work import Done, Written
    from calibrary.jobs.undistort.report import UndistortReport

__all__ = ["report_of", "show"]


def report_of(
    arguments: argparse.Namespace, done: Sequence[Done], cameras: Mapping[ImageSize, Written]
) -> UndistortReport:
    """What was done."""
    from calibrary.jobs.undistort.report import UndistortedCamera, UndistortedImage, UndistortReport

    out: Path = arguments.out
    return UndistortReport(
        calibration=arguments.calibration.name,
        cameras=tuple(
            UndistortedCamera(
                file=camera.path.name,
                format=arguments.to,
                verdict=camera.verdict.outcome,
                dropped=tuple(camera.verdict.dropped),
                image_size=size,
                calibration=camera.calibration,
                kept=camera.plan.kept,
                empty=camera.plan.empty,
                notes=camera.notes,
            )
            for size, camera in cameras.items()
        ),
        images=tuple(
            UndistortedImage(
                file=one.job.image.name,
                output=one.job.output.relative_to(out).as_posix() if one.error is None else None,
                camera=cameras[one.size].path.name if one.size is not None else None,
                warnings=one.warnings,
                error=one.error,
            )
            for one in done
        ),
    )


def show(screen: Screen, done: Sequence[Done], cameras: Mapping[ImageSize, Written], out: Path) -> None:
    """What was done, for people; what was not, on standard error."""
    from calibrary.cli.console import errors, plain

    complaints = errors()
    for one in done:
        if one.error is not None:
            complaints.say(f"[red]not undistorted[/]: {plain(one.error)}")
        for warning in one.warnings:
            complaints.say(f"[yellow]{plain(one.job.image.name)}: {plain(warning)}[/]")
    made = sum(one.error is None for one in done)
    if not cameras:
        return
    for size, camera in cameras.items():
        K, made_plan = camera.plan.intrinsics, camera.plan
        screen.say(
            f"{plain(camera.path.name)}  fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f}  in "
            f"{K.image_size[0]}×{K.image_size[1]} px, no distortion"
        )
        screen.say(
            f"  of {size[0]}×{size[1]} px images: {made_plan.kept:.1%} of the pixels are kept, "
            f"{made_plan.empty:.1%} of the new ones are empty"
        )
        for note in camera.notes:
            screen.say(f"  note: {plain(note)}")
    screen.say(f"undistorted {made} of {len(done)} images into {plain(str(out))}")
