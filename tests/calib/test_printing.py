"""Boards on paper: millimetres stay millimetres in PDF and SVG, whoever draws them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

from calibrary.calib.artwork import Cells, artwork
from calibrary.calib.board import Board, parse_board
from calibrary.calib.printing import Page, lay_out, page_size, to_pdf, to_svg
from calibrary.errors import InputError

MM = 72 / 25.4
BOARDS = [
    parse_board("checkerboard:11x8", 40.0),
    parse_board("charuco:8x5:5x5_100", 30.0),
    parse_board("aprilgrid:4x3", 40.0),
]


def content(pdf: bytes) -> str:
    return pdf.partition(b"stream\n")[2].partition(b"\nendstream")[0].decode("cp1252")


def boxes_in_pdf(pdf: bytes) -> list[tuple[float, ...]]:
    return [
        tuple(map(float, found))
        for found in re.findall(r"^(\S+) (\S+) (\S+) (\S+) re$", content(pdf), re.MULTILINE)
    ]


def boxes_in_svg(svg: bytes) -> list[tuple[float, ...]]:
    path = ET.fromstring(svg).find("{http://www.w3.org/2000/svg}path")  # noqa: S314 — our own
    assert path is not None
    return [
        tuple(map(float, found)) for found in re.findall(r"M(\S+) (\S+?)h(\S+?)v(\S+?)h", path.get("d", ""))
    ]


def drawn(boxes: list[tuple[float, ...]], board: Board, page: Page) -> bool:
    """Whether exactly the board's cells are covered, each once."""
    art = artwork(board)
    assert isinstance(art, Cells)
    x, y = ((line[:-1] + line[1:]) / 2 + o for line, o in zip((art.x, art.y), page.origin_mm, strict=True))
    cover = np.zeros((len(y), len(x)), dtype=int)
    for left, top, width, height in boxes:
        cover += ((y > top) & (y < top + height))[:, None] & ((x > left) & (x < left + width))
    return bool((cover == art.dark).all())


@pytest.mark.parametrize("board", BOARDS, ids=str)
def test_both_files_hold_the_boards_cells_and_nothing_else_on_them(board: Board) -> None:
    page = lay_out(board)
    assert drawn(boxes_in_pdf(to_pdf(board, page)), board, page)
    assert drawn(boxes_in_svg(to_svg(board, page)), board, page)


def test_the_pdf_counts_in_millimetres_from_the_upper_left_corner() -> None:
    pdf = to_pdf(BOARDS[0], lay_out(BOARDS[0]))
    scale, zero, _, minus, left, top = map(float, content(pdf).splitlines()[0].split()[:6])
    assert (scale, zero, minus, left, top) == pytest.approx((MM, 0, -MM, 0, 420 * MM))
    assert f"/MediaBox [0 0 {594 * MM:.6f} {420 * MM:.6f}]".encode() in pdf
    assert b"/PrintScaling /None" in pdf


def test_the_pdfs_table_points_at_its_objects() -> None:
    pdf = to_pdf(BOARDS[1], lay_out(BOARDS[1]))
    start = int(pdf.rpartition(b"startxref\n")[2].split()[0])
    rows = pdf[start:].splitlines()[3:8]
    for number, row in enumerate(rows, start=1):
        assert pdf[int(row[:10]) :].startswith(b"%d 0 obj" % number)
    length = int(re.search(rb"/Length (\d+)", pdf)[1])  # type: ignore[index]  # there is one
    assert pdf.partition(b"stream\n")[2][length:].startswith(b"\nendstream")


def test_the_svg_is_as_large_as_the_paper() -> None:
    root = ET.fromstring(to_svg(BOARDS[0], lay_out(BOARDS[0])))  # noqa: S314 — our own
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("594mm", "420mm", "0 0 594 420")


def test_the_ruler_is_a_hundred_millimetres_between_its_outer_edges() -> None:
    page = lay_out(BOARDS[0])
    ruler = [box for box in boxes_in_svg(to_svg(BOARDS[0], page)) if box[1] >= page.strip_mm[1]]
    left, right = min(box[0] for box in ruler), max(box[0] + box[2] for box in ruler)
    assert right - left == pytest.approx(100)
    ticks = sorted(box[0] + box[2] / 2 for box in ruler if box[2] < 1)
    assert np.diff(ticks[1:-1]) == pytest.approx(1)
    lengths = [box[3] for box in sorted(ruler) if box[2] < 1]
    assert {*lengths[::10]} == {3.0}
    assert {*lengths[5::10]} == {2.2}
    assert {length for at, length in enumerate(lengths) if at % 5} == {1.4}


def test_the_ruler_of_a_narrow_page_is_as_many_centimetres_as_leave_room_for_the_arrow() -> None:
    board = parse_board("checkerboard:3x9", 10.0)
    page = lay_out(board, (104.0, 400.0))
    assert page.ruler_mm == 80
    tips = re.findall(r"M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)", to_svg(board, page).decode())
    left, base, middle, top, right, again = map(float, tips[0])
    assert page.strip_mm[0] + page.ruler_mm < left < right <= page.width_mm - page.strip_mm[0]
    assert middle == pytest.approx((left + right) / 2)
    assert (top < base, base) == (True, again)


def test_the_margin_says_what_calibrate_wants_to_hear() -> None:
    for write in (to_pdf, to_svg):
        text = write(BOARDS[1], lay_out(BOARDS[1])).decode("latin-1")
        assert "--board charuco:8x5:5x5_100 --square-mm 30 --marker-mm 22.5" in text
        assert "100 %" in text
        assert "up" in text


def test_circles_are_round() -> None:
    board = parse_board("circles:4x3", 20.0)
    page = lay_out(board)
    ox, oy = page.origin_mm
    root = ET.fromstring(to_svg(board, page))  # noqa: S314 — our own
    circles = [
        tuple(float(c.get(name, "nan")) for name in ("cx", "cy", "r"))
        for c in root.iter("{http://www.w3.org/2000/svg}circle")
    ]
    np.testing.assert_allclose(circles, [(ox + x, oy + y, 5) for x, y, _ in board.points], atol=1e-4)
    curves = [line.split() for line in content(to_pdf(board, page)).splitlines() if line.endswith(" c")]
    assert len(curves) == 4 * 12
    x1, y1, x2, y2, x3, y3 = map(float, curves[0][:6])
    middle = np.array([(ox + 5 + 3 * x1 + 3 * x2 + x3) / 8, (oy + 3 * y1 + 3 * y2 + y3) / 8])
    assert np.hypot(*(middle - (ox, oy))) == pytest.approx(5, rel=3e-4)


def test_the_smallest_paper_that_holds_the_board_is_taken_the_way_it_lies() -> None:
    assert (lay_out(parse_board("checkerboard:9x6", 25.0)).width_mm) == 420
    tall = lay_out(parse_board("checkerboard:6x9", 25.0))
    assert (tall.width_mm, tall.height_mm) == (297, 420)
    huge = lay_out(parse_board("checkerboard:30x20", 50.0))
    assert huge.width_mm == 31 * 50 + 2 * (15 + 7)


def test_the_print_keeps_clear_of_the_rim_and_the_ruler() -> None:
    for board in BOARDS:
        page = lay_out(board)
        left, top, right, bottom = artwork(board).extent_mm
        ox, oy = page.origin_mm
        assert min(ox + left, oy + top, page.width_mm - ox - right) >= 15
        assert oy + bottom <= page.strip_mm[1] - 15


def test_paper_that_is_too_small_is_refused_with_what_is_needed() -> None:
    with pytest.raises(InputError, match="needs 524×418 mm"):
        lay_out(BOARDS[0], page_size("a4"))
    with pytest.raises(InputError, match="at most 5000 mm"):
        lay_out(parse_board("checkerboard:100x100", 100.0))


@pytest.mark.parametrize("text", ["a9", "10x10", "400", "1e3x400", "99999x400", ""])
def test_what_is_no_page_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="WIDTHxHEIGHT"):
        page_size(text)


@pytest.mark.parametrize("board", BOARDS, ids=str)
@pytest.mark.parametrize(
    ("program", "suffix"), [("pdftoppm", ".pdf"), ("rsvg-convert", ".svg")], ids=["poppler", "librsvg"]
)
def test_rasterised_by_others_points_lie_within_two_hundredths_of_a_millimetre(
    board: Board, program: str, suffix: str, tmp_path: Path
) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed; the files' numbers are checked above")
    page = lay_out(board)
    path = tmp_path / f"board{suffix}"
    path.write_bytes((to_pdf if suffix == ".pdf" else to_svg)(board, page))
    # 254 dpi is ten pixels a millimetre.
    command = {
        ".pdf": ["pdftoppm", "-r", "254", "-gray", "-png", "-singlefile", str(path), str(tmp_path / "page")],
        ".svg": ["rsvg-convert", "-d", "254", "-p", "254", str(path), "-o", str(tmp_path / "page.png")],
    }
    subprocess.run(command[suffix], check=True)
    picture = cv2.imread(str(tmp_path / "page.png"), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    expected = (board.points[:, :2] + page.origin_mm) * 10
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    start = (expected - 0.5).astype(np.float32).reshape(-1, 1, 2)
    found = cv2.cornerSubPix(picture, start, (9, 9), (-1, -1), criteria).reshape(-1, 2) + 0.5
    # Poppler samples each pixel at 4×4 points, which is 0.025 mm here.
    assert np.abs(found - expected).max() < 0.2
