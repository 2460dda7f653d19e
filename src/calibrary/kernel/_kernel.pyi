from typing import Any

from numpy.typing import NDArray

LAYOUT: int

def project(plan: NDArray[Any], rays: NDArray[Any], pixels: NDArray[Any], /) -> int: ...
def unproject(plan: NDArray[Any], pixels: NDArray[Any], rays: NDArray[Any], /) -> int: ...
def map(  # noqa: A001
    plan: NDArray[Any], pinhole: NDArray[Any], row: int, rows: int, width: int, w: float, h: float,
    x: NDArray[Any], y: NDArray[Any], seen: NDArray[Any], /,
) -> None: ...  # fmt: skip
