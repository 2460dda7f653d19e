"""``calibrary undistort``: undistort images, and write the K that applies to the undistorted images."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.undistort import undistort

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.undistort.run import UndistortReport

DESCRIPTION = "Remove lens distortion from images, and write the new K beside them."
EXAMPLES = """\
examples:
  calibrary undistort flight/ --calibration camera.xml              into ./undistorted
  calibrary undistort a.jpg --calibration camera.xml --keep all     no pixel is lost
  calibrary undistort a.jpg --calibration camera.xml --keep valid   no pixel is empty
  calibrary undistort a.jpg --calibration camera.xml --keep 0.3     as with OpenCV's alpha 0.3
  calibrary undistort *.tif --calibration rig.xml --camera 2 --keep all --size same-focal
  calibrary undistort flight/ --calibration camera.xml --to colmap --mask

The new K is written beside the pictures, without distortion. The orientation of EXIF is not applied. JPEG and PNG
keep the colour profile and EXIF (without maker's notes and thumbnail; without focal lengths if these change). They do
not keep XMP, because cameras store their distortion there; it states "lens profile applied" instead. TIFFs keep only
the pixels.

exit code 0: every picture was undistorted; 3: at least one was not.
"""

EXIT_UNREADABLE = 3
GROUPS = {
    "what the new pictures show": ("keep", "size", "max_angle_deg"),
    "how they are written": ("interpolation", "kind", "quality", "mask", "to"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, undistort, positional={"images": "IMAGE"}, groups=GROUPS)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    with Bar(note(arguments), "undistorting") as bar:
        done = call(undistort, arguments, progress=bar)
    if arguments.json:
        print_json(done)
    else:
        _show(out(arguments), done, arguments.out or "undistorted")
    return 0 if done.is_good else EXIT_UNREADABLE


def _show(screen: Screen, done: UndistortReport, folder: str) -> None:
    """Show what was done; show what was not done on standard error."""
    from calibrary.cli.console import errors, plain

    complaints = errors()
    for image in done.images:
        if image.error is not None:
            complaints.say(f"[red]not undistorted[/]: {plain(image.error)}")
        for warning in image.warnings:
            complaints.say(f"[yellow]{plain(image.file)}: {plain(warning)}[/]")
    if not done.cameras:
        return
    for camera in done.cameras:
        K, size = camera.calibration.intrinsics, camera.image_size
        screen.say(
            f"{plain(camera.file)}  fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f}  in "
            f"{K.image_size[0]}×{K.image_size[1]} px, no distortion"
        )
        screen.say(
            f"  of {size[0]}×{size[1]} px images: {camera.kept:.1%} of the pixels are kept, "
            f"{camera.empty:.1%} of the new ones are empty"
        )
        for note in camera.notes:
            screen.say(f"  note: {plain(note)}")
    made = sum(one.error is None for one in done.images)
    screen.say(f"undistorted {made} of {len(done.images)} images into {plain(folder)}")
