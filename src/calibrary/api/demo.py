"""The synthetic flight of a mixed fleet, to try calibrary on."""

from __future__ import annotations

from pathlib import Path

from calibrary.errors import InputError
from calibrary.extras import require
from calibrary.jobs.demo.flight import DemoImage, write_flight

__all__ = ["write_demo"]


def write_demo(folder: str | Path, *, seed: int = 7) -> list[DemoImage]:
    """Write the flight; each image says how it should be judged, and for what reason.

    Args:
        folder: is made.
        seed: of the country that is flown over; the cameras stay the same.

    Raises:
        InputError: it cannot be written.
        MissingExtraError: Pillow, which writes its images, is not installed.
    """
    require(["PIL"], "the demo")
    try:
        return write_flight(Path(folder), seed=seed)
    except OSError as error:
        raise InputError(f"cannot write the flight: {error.strerror or error}", source=str(folder)) from None
