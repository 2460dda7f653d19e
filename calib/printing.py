"""Boards as PDF or SVG in exact millimetres, with a ruler beside the pattern to check the print.

Both formats are written directly: a page of rectangles needs no library, and no rounding may occur between the numbers
and the page. The PDF also asks the viewer not to scale the page to the paper.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.calib.artwork import Cells, Discs, artwork
from calibrary.calib.board import Board, Pattern
from calibrary.errors import InputError

Rectangle: TypeAlias = tuple[float, float, float, float]
"""(left, top, width, height) in mm on the page."""

PAGES: Final = MappingProxyType(
    {
        "a4": (210.0, 297.0),
        "letter": (215.9, 279.4),
        "a3": (297.0, 420.0),
        "tabloid": (279.4, 431.8),
        "a2": (420.0, 594.0),
        "a1": (594.0, 841.0),
        "a0": (841.0, 1189.0),
    }
)
"""(shorter, longer) side in mm of the paper sizes by name."""
_AUTOMATIC = ("a4", "a3", "a2", "a1", "a0")

RIM_MM = 7.0
"""Margin along the page's edges; few printers can print closer."""
STRIP_MM = 14.0
"""Height of the strip below the pattern for ruler and name."""
QUIET_MM = 15.0
"""White margin around the pattern (one square if squares are smaller), which detectors need."""
SMALLEST_MM, LARGEST_MM = 50.0, 5000.0
"""A PDF page may measure up to 14400 points."""
RULER_MM = 100.0
TEXT_MM = 3.2


class Page(Struct, frozen=True, kw_only=True):
    """Layout of a page.

    Attributes:
        width_mm, height_mm: size of the paper.
        origin_mm: position of the board's first point, from the upper left corner of the page.
        strip_mm: (left, top) of the strip for ruler and name.
        ruler_mm: length of the ruler.
    """

    width_mm: float
    height_mm: float
    origin_mm: tuple[float, float]
    strip_mm: tuple[float, float]
    ruler_mm: float


def page_size(text: str) -> tuple[float, float]:
    """Return (width, height) in mm of "a3", "letter", or "500x400".

    Raises:
        InputError: the text is not a page size.
    """
    name = text.strip().lower()
    if name in PAGES:
        return PAGES[name]
    match = re.fullmatch(r"(\d{1,5}(?:\.\d{1,3})?)[x×](\d{1,5}(?:\.\d{1,3})?)", name)
    sides = (float(match[1]), float(match[2])) if match else (0.0, 0.0)
    if not (min(sides) >= SMALLEST_MM and max(sides) <= LARGEST_MM):
        raise InputError(
            f"page {text!r:.40}: expected one of {', '.join(PAGES)} or WIDTHxHEIGHT of 50 … 5000 mm"
        )
    return sides


def lay_out(board: Board, size_mm: tuple[float, float] | None = None) -> Page:
    """Place a board in the centre of a page, with the ruler below it.

    Args:
        board: board to print.
        size_mm: paper size in either orientation; None selects the smallest A size that is large enough, or a page of
            the required size.

    Raises:
        InputError: the paper is too small.
    """
    left, top, right, bottom = artwork(board).extent_mm
    quiet = min(board.scale_mm("a print"), QUIET_MM)
    need = right - left + 2 * (quiet + RIM_MM), bottom - top + 2 * quiet + RIM_MM + STRIP_MM + RIM_MM
    need = max(need[0], 2 * RIM_MM + 90.0), need[1]
    if size_mm is not None:
        page = _turned(size_mm, need)
        if page is None:
            raise InputError(
                f"{board.described} squares needs {need[0]:.0f}×{need[1]:.0f} mm with its margins; "
                f"the page has {size_mm[0]:g}×{size_mm[1]:g} mm; choose a larger page or smaller squares"
            )
    else:
        fitting = (_turned(PAGES[name], need) for name in _AUTOMATIC)
        page = next((size for size in fitting if size is not None), None) or (
            math.ceil(need[0]),
            math.ceil(need[1]),
        )
    width, height = page
    if max(page) > LARGEST_MM:
        raise InputError(
            f"{board.described} squares needs a page of {width:g}×{height:g} mm; "
            f"expected at most {LARGEST_MM:g} mm along a side"
        )
    strip_top = height - RIM_MM - STRIP_MM
    return Page(
        width_mm=width,
        height_mm=height,
        origin_mm=((width - left - right) / 2, (strip_top - top - bottom) / 2),
        strip_mm=(RIM_MM, strip_top),
        ruler_mm=min(RULER_MM, 10.0 * math.floor((width - 2 * RIM_MM - 10) / 10)),
    )


def _turned(size_mm: tuple[float, float], need: tuple[float, float]) -> tuple[float, float] | None:
    """Return the page in the orientation in which the board fits; in the board's own if both fit."""
    shorter, longer = sorted(size_mm)
    across, upright = (longer, shorter), (shorter, longer)
    for width, height in (across, upright) if need[0] > need[1] else (upright, across):
        if width >= need[0] and height >= need[1]:
            return width, height
    return None


def to_pdf(board: Board, page: Page) -> bytes:
    """Return a PDF of one page (ISO 32000-1), with coordinates in mm from the upper left corner."""
    mm = 72 / 25.4
    # Flip the y axis so that y increases downwards; text is flipped back.
    drawing = [f"{mm:.10f} 0 0 {-mm:.10f} 0 {page.height_mm * mm:.10f} cm", "0 g"]
    drawing += [f"{_n(x)} {_n(y)} {_n(w)} {_n(h)} re" for x, y, w, h in _rectangles(board, page)]
    drawing += [line for x, y, r in _circles(board, page) for line in _bezier_circle(x, y, r)]
    drawing += [" ".join(_pdf_polygon(points)) for points in _polygons(page)]
    # A single path filled at once: adjacent rectangles leave no thin line between them.
    drawing.append("f")
    for x, y, text in _texts(board, page):
        drawing.append(f"BT /F1 {TEXT_MM} Tf 1 0 0 -1 {_n(x)} {_n(y)} Tm ({_pdf_text(text)}) Tj ET")
    stream = "\n".join(drawing).encode("cp1252")
    box = f"[0 0 {page.width_mm * mm:.6f} {page.height_mm * mm:.6f}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    return _pdf_file(objects)


def to_svg(board: Board, page: Page) -> bytes:
    """Return an SVG with mm as user units."""
    width, height = _n(page.width_mm), _n(page.height_mm)
    path = "".join(f"M{_n(x)} {_n(y)}h{_n(w)}v{_n(h)}h{_n(-w)}z" for x, y, w, h in _rectangles(board, page))
    path += "".join("M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points) + "z" for points in _polygons(page))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        f'<path d="{path}"/>',
    ]
    lines += [f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(r)}"/>' for x, y, r in _circles(board, page)]
    lines += [
        f'<text x="{_n(x)}" y="{_n(y)}" font-family="Helvetica, Arial, sans-serif" font-size="{TEXT_MM}">{text}</text>'
        for x, y, text in _texts(board, page)
    ]
    return ("\n".join([*lines, "</svg>"]) + "\n").encode()


def _rectangles(board: Board, page: Page) -> Iterator[Rectangle]:
    """Yield the dark cells of the pattern, then the ruler."""
    art = artwork(board)
    if isinstance(art, Cells):
        ox, oy = page.origin_mm
        for row, line in enumerate(art.dark):
            edges = np.flatnonzero(np.diff(line.astype(np.int8)))
            # The outer cells are white, so edges come in pairs.
            for start, stop in edges.reshape(-1, 2) + 1:
                x, y = art.x[start], art.y[row]
                yield ox + float(x), oy + float(y), float(art.x[stop] - x), float(art.y[row + 1] - y)
    left, top = page.strip_mm
    yield left, top + 8.0, page.ruler_mm, 0.2
    for mm in range(round(page.ruler_mm) + 1):
        length = 3.0 if mm % 10 == 0 else 2.2 if mm % 5 == 0 else 1.4
        # The centre of a tick is its position; the outermost ones are flush, so that a calliper measures the length.
        at = min(max(mm - 0.1, 0.0), page.ruler_mm - 0.2)
        yield left + at, top + 8.0 - length, 0.2, length


def _circles(board: Board, page: Page) -> Iterator[tuple[float, float, float]]:
    art = artwork(board)
    if isinstance(art, Discs):
        ox, oy = page.origin_mm
        for x, y, _ in board.points:
            yield ox + float(x), oy + float(y), art.radius_mm


def _polygons(page: Page) -> Iterator[Sequence[tuple[float, float]]]:
    """Yield the arrow that marks the upper side."""
    left, top = page.strip_mm
    x, y = left + page.ruler_mm + 5, top + 8.2
    yield (x, y), (x + 2.5, y - 4.5), (x + 5, y)


def _texts(board: Board, page: Page) -> Iterator[tuple[float, float, str]]:
    left, top = page.strip_mm
    yield left, top + 3.4, f"print at 100 %: this ruler measures {page.ruler_mm:g} mm"
    yield left + page.ruler_mm + 5, top + 2.9, "up"
    yield left, top + 13.0, describe(board)


def describe(board: Board) -> str:
    """Return the options of ``calibrate`` for this board."""
    said = f"--board {board}" + (f":{board.dictionary}" if board.dictionary else "")
    said += f" --square-mm {board.pitch:g}"
    if board.pattern is not Pattern.CHECKERBOARD:
        said += f" --marker-mm {board.marker:.6g}"
    return said


def _n(value: float) -> str:
    """Format a number in mm with four decimals (0.1 µm)."""
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _bezier_circle(x: float, y: float, r: float) -> Iterator[str]:
    """Yield a circle of four Bézier curves, with a relative radius error below 3·10⁻⁴."""
    k = 4 / 3 * (math.sqrt(2) - 1) * r
    yield f"{_n(x + r)} {_n(y)} m"
    for (ax, ay), (bx, by) in (((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0))):
        first = f"{_n(x + ax * r + bx * k)} {_n(y + ay * r + by * k)}"
        second = f"{_n(x + bx * r + ax * k)} {_n(y + by * r + ay * k)}"
        yield f"{first} {second} {_n(x + bx * r)} {_n(y + by * r)} c"
    yield "h"


def _pdf_polygon(points: Sequence[tuple[float, float]]) -> Iterator[str]:
    for number, (x, y) in enumerate(points):
        yield f"{_n(x)} {_n(y)} {'l' if number else 'm'}"
    yield "h"


def _pdf_text(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def _pdf_file(objects: Sequence[bytes]) -> bytes:
    """Return numbered objects, the cross-reference table, and the trailer."""
    parts = [b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n"]
    offsets = []
    for number, content in enumerate(objects, start=1):
        offsets.append(sum(map(len, parts)))
        parts.append(b"%d 0 obj\n%s\nendobj\n" % (number, content))
    start = sum(map(len, parts))
    table = b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    parts.append(b"xref\n0 %d\n0000000000 65535 f \n%s" % (len(objects) + 1, table))
    parts.append(b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start))
    return b"".join(parts)
