"""The synthetic flight with several cameras, for trying calibrary."""

from __future__ import annotations

from pathlib import Path

from calibrary.errors import InputError
from calibrary.extras import require
from calibrary.jobs.demo.flight import DemoImage, write_flight

__all__ = ["write_demo"]


def write_demo(folder: str | Path, *, seed: int = 7) -> list[DemoImage]:
    """Write the synthetic flight; return its images, each with the expected verdict and the reason.

    Args:
        folder: output folder; it is created.
        seed: seed of the synthetic terrain; the cameras stay the same.

    Raises:
        InputError: the files cannot be written.
        MissingExtraError: Pillow is not installed.
    """
    require(["PIL"], "the demo")
    try:
        return write_flight(Path(folder), seed=seed)
    except OSError as error:
        raise InputError(f"cannot write the flight: {error.strerror or error}", source=str(folder)) from None
