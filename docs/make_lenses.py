"""Draw each distortion model's shape: straight lines of a plane as such a lens shows them, into docs/lenses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion import MODELS

__all__ = ["LENSES", "caption", "drawings", "write"]

FOLDER: Final = Path(__file__).parent / "lenses"

LENSES: Final[dict[str, dict[str, float]]] = {
    "none": {},
    "brown": {"k1": -0.28, "k2": 0.06, "p1": 0.01, "p2": 0.02},
    "rational": {"k1": 0.5, "k2": 0.05, "k4": 0.85, "k5": 0.15, "p2": 0.01},
    "thin-prism": {"k1": -0.16, "s1": 0.06, "s3": 0.04},
    "tilted": {"k1": -0.12, "tau_x": 0.08, "tau_y": 0.12},
    "kannala-brandt": {"k1": 0.02, "k2": -0.01},
    "metashape": {"k1": -0.28, "k2": 0.06, "p1": 0.02, "p2": 0.01},
    "observed-brown": {"k1": 0.3, "p1": 0.01, "p2": 0.01},
    "off-centre-brown": {"k1": -0.2, "x0": 0.12, "y0": 0.06},
    "unified": {"xi": 0.9},
    "extended-unified": {"alpha": 0.6, "beta": 1.1},
    "double-sphere": {"xi": -0.2, "alpha": 0.6},
    "field-of-view": {"omega": 0.9},
    "fisheye-polynomial": {"k2": 0.05, "k3": -0.12},
    "australis": {"k1": 0.3, "p1": 0.01, "b1": 0.01},
    "observed-polynomial": {"k1": 0.3, "s1": 0.03, "s3": 0.02},
    "division": {"k": -0.35},
    "fisheye624": {"k1": 0.02, "k2": -0.01, "s0": 0.03, "s2": 0.02},
    "rad-tan-thin-prism-fisheye": {"k0": 0.02, "k1": -0.01, "p0": 0.02, "s2": 0.02},
    "thin-prism-fisheye": {"k1": 0.02, "k2": -0.01, "sx1": 0.03, "sy1": 0.02},
    "scaramuzza": {"c2": -0.35, "c4": -0.05},
}
"""Coefficients of a lens of each model, larger than most so that its shape is seen; the others are 0."""

WIDE: Final = frozenset(
    {"kannala-brandt", "unified", "extended-unified", "double-sphere", "field-of-view", "fisheye-polynomial"}
    | {"fisheye624", "rad-tan-thin-prism-fisheye", "thin-prism-fisheye", "scaramuzza"}
)
"""Models of lenses that are drawn to 63° to the side; the others to 37°."""

PANEL: Final = (420, 290)
LINES: Final = (13, 9)
ALONG: Final = 29
MARGIN: Final = 10.0


def drawings() -> dict[str, str]:
    """Every model's drawing, as SVG, by its name."""
    return {name: _drawn(name) for name in MODELS}


def caption(name: str) -> str:
    """What a drawing shows, in words."""
    stated = ", ".join(f"{key} = {value:g}" for key, value in LENSES[name].items()) or "no coefficients"
    reach = "63°" if name in WIDE else "37°"
    return f"Straight lines as the {name} model shows them ({stated}; to {reach} left and right), and as a pinhole does"


def _drawn(name: str) -> str:
    lens = MODELS[name](**{**dict.fromkeys(MODELS[name].names(), 0.0), **LENSES[name]})
    half = np.array([1.95, 1.3]) if name in WIDE else np.array([0.75, 0.5])
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
