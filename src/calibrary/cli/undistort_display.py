"""Terminal output of ``calibrary undistort``."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.undistort.run import Undistortion

__all__ = ["show"]


def show(screen: Screen, done: Undistortion) -> None:
    """Show what was done; show what was not done on standard error."""
    from calibrary.cli.console import errors, plain

    complaints = errors()
    for one in done.images:
        if one.error is not None:
            complaints.say(f"[red]not undistorted[/]: {plain(one.error)}")
        for warning in one.warnings:
            complaints.say(f"[yellow]{plain(one.image.name)}: {plain(warning)}[/]")
    made = sum(one.error is None for one in done.images)
    if not done.cameras:
        return
    for size, camera in done.cameras.items():
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
    screen.say(f"undistorted {made} of {len(done.images)} images into {plain(str(done.request.out))}")
