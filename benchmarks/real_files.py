"""Are real calibration files read, and as what they state? Over files of public repositories.

    python -m benchmarks.real_files FOLDER

FOLDER holds the files of benchmarks/real_files.csv as ``<owner>+<repository>/<path>``; those that are missing are
counted and left out, and none is part of this project. The table states K of the first camera with the file's own
digits, its lens and the number of cameras. K and coefficients were found again in the file's numbers, by a search that
knows nothing of its format; what is refused is in the table with a K that was read by eye.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import InputError, MissingSizeError

TABLE = Path(__file__).with_name("real_files.csv")
SIZE = (1280, 960)
"""Given where a file does not state its image size."""
NEAR = 1e-6
HALF_PX = 0.501
"""Between the centre of a pixel, or MATLAB's, and the corner."""


def cameras(path: Path) -> list[Calibration]:
    """The cameras of a file."""
    try:
        return list(parsers.read(path))
    except MissingSizeError:
        return list(parsers.read(path, image_size=SIZE))


def is_right(item: Calibration, stated: str) -> bool:
    """Whether K is what the file states."""
    fx, fy, cx, cy = map(float, stated.split())
    K = item.intrinsics
    is_focal = abs(K.fx - fx) <= NEAR * fx and abs(K.fy - fy) <= NEAR * fy
    return is_focal and abs(K.cx - cx) <= HALF_PX and abs(K.cy - cy) <= HALF_PX


def main() -> int:
    """Print what is refused and what is wrong, and how many are right."""
    if len(sys.argv) < 2:
        print("no files of real_files.csv here: nothing to measure")
        return 0
    counts = {"right": 0, "wrong": 0, "refused": 0, "missing": 0}
    for row in csv.DictReader(TABLE.read_text().splitlines()):
        path = Path(sys.argv[1], row["repository"].replace("/", "+"), row["path"])
        found = "missing"
        if path.is_file():
            try:
                every = cameras(path)
                lens = every[0].distortion.model if every[0].distortion is not None else "unknown"
                same = is_right(every[0], row["K"]) and (lens, str(len(every))) == (
                    row["lens"],
                    row["cameras"],
                )
                found = "right" if same else "wrong"
            except InputError as error:
                print(f"refused: {error}")
                found = "refused"
        counts[found] += 1
        if found == "wrong":
            print(f"wrong: {row['repository']} {row['path']}")
    print(", ".join(f"{count} {word}" for word, count in counts.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
