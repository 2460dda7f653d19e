"""Write synthetic images to try calibrary on: a mixed flight, some of it bad on purpose, and the folders of the README.

>>> from calibrary.jobs.demo import demo
>>> sorted({image.name.split("/")[0] for image in demo("tryout")})
['flight']
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.arguments import Folder
from calibrary.errors import InputError
from calibrary.extras import require

if TYPE_CHECKING:
    from calibrary.jobs.demo.flight import DemoImage

__all__ = ["demo"]


def demo(folder: Folder, *, seed: int = 7) -> list[DemoImage]:
    """Write a synthetic flight, and beside it a survey by one camera, an odd camera and a new payload.

    Args:
        folder: folder to write flight, survey, odd-camera and payload into; it is created.
        seed: seed of the synthetic terrain; the cameras stay the same.

    Returns:
        The images of the flight, each with the expected verdict and the reason.

    Raises:
        InputError: the files cannot be written.
        MissingExtraError: Pillow is not installed.
    """
    require(["PIL"], "the demo")
    from calibrary.jobs.demo.flight import write_demo

    try:
        return write_demo(Path(folder), seed=seed)
    except OSError as error:
        raise InputError(f"cannot write the flight: {error.strerror or error}", source=str(folder)) from None
