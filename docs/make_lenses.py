"""Draw each distortion model's shape: straight lines of a plane as such a lens shows them, into docs/lenses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion import MODELS

__all__ = ["caption", "drawings", "write"]

FOLDER: Final = Path(__file__).parent / "lenses"

PANEL: Final = (420, 290)
HALF_PANELS: Final = {37.0: np.array([0.75, 0.5]), 63.0: np.array([1.95, 1.3])}
"""Half of a panel's width and height in undistorted coordinates, by the angle that it reaches to the side."""
LINES: Final = (13, 9)
ALONG: Final = 29
MARGIN: Final = 10.0


def drawings() -> dict[str, str]:
    """Every model's drawing, as SVG, by its name."""
    return {name: _drawn(name) for name in MODELS}


def caption(name: str) -> str:
    """What a drawing shows, in words."""
    kind = MODELS[name]
    numbers = {key: value for key, value in kind.example.items() if not isinstance(value, tuple)}
    stated = ", ".join(f"{key} = {value:g}" for key, value in numbers.items()) or "no coefficients"
    reach = f"to {kind.example_reach_deg:g}° left and right"
    return f"Straight lines as the {name} model shows them ({stated}; {reach}), and as a pinhole does"


def _drawn(name: str) -> str:
    kind = MODELS[name]
    lens = kind(**{**dict.fromkeys(kind.names(), 0.0), **kind.example})
    half = HALF_PANELS[kind.example_reach_deg]
    width, height = PANEL
    scale = (width / 2 - MARGIN) / half[0]

    def path(points: FloatArray) -> str:
        pixels = points * scale + np.array(PANEL) / 2
        good = np.isfinite(pixels).all(axis=1)
        steps = ["M" if not before else "L" for before in np.concatenate([[False], good[:-1]])]
        return "".join(
            f"{step}{x:.1f} {y:.1f}" for step, (x, y), ok in zip(steps, pixels, good, strict=True) if ok
        )

    pale = "".join(path(line[[0, -1]]) for line in _lines(half))
    seen = "".join(path(lens.distort(line)) for line in _lines(half))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f'<path d="{pale}" fill="none" stroke="#9aa3ad" stroke-width="0.7" stroke-dasharray="2 3"/>'
        f'<path d="{seen}" fill="none" stroke="#2f7fd1" stroke-width="1.5"/></svg>\n'
    )


def _lines(half: FloatArray) -> Iterator[FloatArray]:
    """(N, 2) points of each line of a grid, undistorted."""
    t = np.linspace(-1.0, 1.0, ALONG)
    for x in np.linspace(-1.0, 1.0, LINES[0]):
        yield np.column_stack([np.full_like(t, x), t]) * half
    for y in np.linspace(-1.0, 1.0, LINES[1]):
        yield np.column_stack([t, np.full_like(t, y)]) * half


def write(folder: Path = FOLDER) -> None:
    """Write every drawing."""
    folder.mkdir(exist_ok=True)
    for name, svg in drawings().items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")
