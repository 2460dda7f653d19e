"""Search for a board that is not known: what each image shows, and the board or the sentence that follows from it.

Nothing that was seen is dropped, so "not found" is said only of images that show neither markers nor squares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Final, TypeVar

import numpy as np
from msgspec import Struct

from calibrary.calib.board import LARGEST, Board, Pattern
from calibrary.calib.detectors.anymarkers import LaidOut, Layout, Markers, find_markers, laid_out
from calibrary.calib.detectors.checkerboard import grown_board
from calibrary.calib.found import Found
from calibrary.calib.frames import Gray
from calibrary.errors import CalibrationError
from calibrary.records import replace

Vote = TypeVar("Vote", tuple[int, int], tuple[str, Layout])

MOST_IMAGES: Final = 40
ENOUGH_VOTES: Final = 3
SEEN_TWICE: Final = 2
"""Images that must show the highest marker, if more than two show any: in one alone it may be misread."""
KALIBRS_SHARE, CHARUCOS_SHARE, SHARE_OFF = 1 / 1.3, 0.75, 0.05
"""Usual sides of a marker as shares of the distance of tags and squares, and the difference that is noticed."""
NAME_IT: Final = "name it with --board, such as checkerboard:11x8 for 11×8 inner corners"


class Seen(Struct, frozen=True, kw_only=True, eq=False):
    """What one image shows.

    Attributes:
        lattice: (columns, rows) of the largest piece of a checkerboard, None without one.
        whole: whether this is all of a checkerboard.
        dropped: why it is none.
        markers: the markers of each dictionary, the most numerous first.
        laid_out: the first of them, if they are arranged as on a board.
    """

    lattice: tuple[int, int] | None
    whole: bool
    dropped: str = ""
    markers: tuple[Markers, ...] = ()
    laid_out: LaidOut | None = None


def look(gray: Gray) -> Seen:
    """Return what an image, (H, W), shows: a checkerboard of any size, or markers of any dictionary."""
    lattice, found = grown_board(gray, LARGEST)
    if isinstance(found, Found):
        return Seen(lattice=lattice, whole=True)
    markers = find_markers(gray)
    arranged = laid_out(markers[0]) if markers else None
    return Seen(lattice=lattice, whole=False, dropped=found.text, markers=markers, laid_out=arranged)


def look_until_sure(images: Iterable[Gray]) -> list[Seen]:
    """Look at images until three agree on a board, with at most one that disagrees; at most at forty."""
    records: list[Seen] = []
    for image in islice(images, MOST_IMAGES):
        records.append(look(image))
        votes = (*_sizes(records).values(), *_layouts(records).values(), 0, 0)
        first, second = sorted(votes, reverse=True)[:2]
        if first >= ENOUGH_VOTES and second <= 1:
            break
    return records


def board_of(records: Sequence[Seen], square_mm: float | None) -> tuple[Board, str]:
    """Return the board that images show, and its description.

    Args:
        records: of one image each.
        square_mm: side of a square, or distance of tags, in mm; None if unknown.

    Raises:
        CalibrationError: they show none, only a part of one, or several; the message says what they show.
    """
    sizes, layouts = _sizes(records), _layouts(records)
    if layouts.total() > sizes.total():
        family, layout = _winner(layouts, len(records))
        return _with_markers(records, family, layout, square_mm)
    if not sizes:
        raise CalibrationError(_no_board(records))
    columns, rows = _winner(sizes, len(records))
    board = Board(columns=columns, rows=rows, square_mm=square_mm)
    return board, str(board)


def contradiction(stated: Board, seen: Board) -> str | None:
    """Return how the board that images show differs from the stated one; None if it may be the same, or a part of it.

    The sentence says what to state instead.
    """
    given, shown = (stated.columns, stated.rows), (seen.columns, seen.rows)
    name = f"{seen}:{seen.dictionary}" if seen.has_markers else str(seen)
    like = "" if seen.pattern is stated.pattern else f" on a {seen.pattern.value}"
    size = f"{shown[0]}×{shown[1]} {'tags' if seen.pattern is Pattern.APRILGRID else 'inner corners'}{like}"
    squares = (shown[0] + 1, shown[1] + 1)
    if seen.pattern is not Pattern.APRILGRID and given in (squares, squares[::-1]):
        return f"{given[0]}×{given[1]} are its squares, it has {size}; give {name}"
    if seen.pattern is not stated.pattern:
        return f"the frames show {size}; give {name}"
    if not seen.has_markers:
        return f"it has {size}; give {name}" if sorted(given) != sorted(shown) else None
    if _family(seen) != _family(stated):
        other = f", and {size}" if given != shown else ""
        return f"its markers are of {seen.dictionary}, not {stated.dictionary}{other}; give {name}"
    if given != shown and given == shown[::-1]:
        return f"its columns and rows are exchanged, it has {size}; give {name}"
    # Rows that are outside all images are not missed.
    return f"it has {size}; give {name}" if given[0] != shown[0] or given[1] < shown[1] else None


def _family(board: Board) -> str | None:
    """Return the dictionary without its size, since the smaller ones are the beginning of the larger."""
    return (
        board.dictionary
        if board.dictionary is None or "apriltag" in board.dictionary
        else board.dictionary[:3]
    )


def _sizes(records: Sequence[Seen]) -> Counter[tuple[int, int]]:
    return Counter(record.lattice for record in records if record.whole and record.lattice is not None)


def _layouts(records: Sequence[Seen]) -> Counter[tuple[str, Layout]]:
    return Counter(
        (record.markers[0].dictionary, record.laid_out.layout)
        for record in records
        if record.laid_out is not None
    )


def _winner(votes: Counter[Vote], images: int) -> Vote:
    """Return what most images show.

    Raises:
        CalibrationError: two are shown equally often.
    """
    most = max(votes.values())
    first, *rivals = [shown for shown, count in votes.items() if count == most]
    if rivals:
        named = f"{_named(first)} and of {_named(rivals[0])}"
        raise CalibrationError(f"boards of {named} fit {most} of {images} frames each; name the right one")
    return first


def _named(shown: tuple[int, int] | tuple[str, Layout]) -> str:
    across, down = shown
    if isinstance(down, Layout):
        return f"{down.across} squares in a row with markers of {across}"
    return f"{across}×{down} inner corners"


def _with_markers(
    records: Sequence[Seen], family: str, layout: Layout, square_mm: float | None
) -> tuple[Board, str]:
    """Return the board on which markers are arranged, and its description."""
    fits = [
        record.laid_out
        for record in records
        if record.laid_out is not None
        and (record.markers[0].dictionary, record.laid_out.layout) == (family, layout)
    ]
    seen = Counter(int(marker) for fit in fits for marker in fit.ids)
    highest = max(marker for marker, count in seen.items() if count >= SEEN_TWICE or len(fits) <= SEEN_TWICE)
    board = layout.board(highest, family, square_mm)
    share = float(np.median([fit.share for fit in fits]))
    kalibrs = layout.pattern is Pattern.APRILGRID
    if board is None:
        raise CalibrationError(
            f"markers of {family} seen in {len(fits)} of {len(records)} frames, on a board too small to detect"
        )
    described = f"{board} with markers of {board.dictionary}"
    if kalibrs and abs(share - KALIBRS_SHARE) > SHARE_OFF:
        raise CalibrationError(
            f"{described} is seen, whose tags are {share:.2f} of their distance and not {KALIBRS_SHARE:.2f} as on "
            f"Kalibr's; say --board {board}:{board.dictionary} with --square-mm and --marker-mm"
        )
    if square_mm is not None and not kalibrs and abs(share - CHARUCOS_SHARE) > SHARE_OFF:
        board = replace(board, marker_mm=round(share * square_mm, 2))
    return board, f"{described}, laid out as before OpenCV 4.6" if layout.legacy else described


def _no_board(records: Sequence[Seen]) -> str:
    """Return what images show that show no whole board."""
    marked = [record.markers[0] for record in records if record.markers]
    if marked:
        kinds = Counter(markers.dictionary for markers in marked).most_common(1)[0][0]
        count = sum(len(markers.ids) for markers in marked)
        return (
            f"{count} markers of {kinds} seen in {len(marked)} of {len(records)} frames, arranged as on no ChArUco "
            "board or AprilGrid of Kalibr"
        )
    pieces = [(record.lattice, record.dropped) for record in records if record.lattice is not None]
    if pieces:
        (columns, rows), dropped = max(pieces, key=lambda piece: piece[0][0] * piece[0][1])
        return (
            f"squares seen in {len(pieces)} of {len(records)} frames, but no checkerboard as a whole; of the largest "
            f"piece, {columns}×{rows} corners: {dropped}; {NAME_IT}"
        )
    return (
        f"neither squares nor markers found in {len(records)} frames; the board must be sharp and lit, and one of "
        "circles be named with --board"
    )
