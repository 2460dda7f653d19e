"""What an undistortion shows: the new cameras, and which images were not undistorted."""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.jobs.undistort.run import UndistortedCamera, UndistortReport
from calibrary.pages.wording import count, made_by
from calibrary.view import Badge, Block, Note, Section, Tone, View


def told(done: UndistortReport, folder: str) -> View:
    """Describe what was written into a folder."""
    made = sum(one.error is None for one in done.images)
    blocks = [block for camera in done.cameras for block in _camera(camera)]
    for image in done.images:
        blocks += [Note(text=f"{image.file}: {text}", tone=Tone.CAUTION) for text in image.warnings]
        if image.error is not None:
            blocks.append(Note(text=f"not undistorted: {image.error}", tone=Tone.BAD))
    return View(
        title=f"Images without distortion: {count(made, 'image')}",
        badge=Badge("undistorted", Tone.GOOD) if done.is_good else Badge("not all undistorted", Tone.BAD),
        lead=f"undistorted {made} of {len(done.images)} images into {folder}",
        sections=(Section(title="Cameras", blocks=tuple(blocks)),),
        made_by=made_by(),
    )


def _camera(camera: UndistortedCamera) -> Iterator[Block]:
    K, size = camera.calibration.intrinsics, camera.image_size
    yield (
        f"{camera.file}  fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f}  in "
        f"{K.image_size[0]}×{K.image_size[1]} px, no distortion"
    )
    yield (
        f"of {size[0]}×{size[1]} px images: {camera.kept:.1%} of the pixels are kept, {camera.empty:.1%} of the new "
        "ones are empty"
    )
    yield from (Note(text=text) for text in camera.notes)
