"""Verdicts over a table of what real images say, against fx by the sensor widths that two databases list.

A table is a CSV of EXIF tags, one image a row: make, model, file_w, file_h, exif_w, exif_h, orientation,
focal_mm, focal_35mm, fp_x_res, fp_y_res, fp_unit, software, digital_zoom, lens, fx_by_opensfm_width and
fx_by_alicevision_width. Three figures are printed, for the whole table and for two halves that share no camera:

* valid K's more than 3 % off the databases' fx, which should be none;
* rejected K's, which should be at most 5 %, because every one of these rows has a focal length and a width;
* unproven K's more than 10 % off, which should be none.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.jobs.extract.real_tags import TABLE, all_judged, figures, read_table


def main() -> int:
    """Judge a table and print the figures."""
    parser = argparse.ArgumentParser(description="Verdicts over a table of real images' tags.")
    parser.add_argument("table", nargs="?", type=Path, default=TABLE, help="CSV (default: the tests')")
    parser.add_argument("-v", action="store_true", help="name the rows behind the figures")
    parser.add_argument("--half", type=int, choices=(0, 1), help="only this half's rows with -v")
    parser.add_argument("--quick", action="store_true", help="accepted as by every benchmark; it is quick")
    arguments = parser.parse_args()
    outcomes = all_judged(read_table(arguments.table))
    counts = Counter(one.verdict.value if one.verdict else "skipped" for one in outcomes)
    print(f"{len(outcomes)} rows: {', '.join(f'{count} {name}' for name, count in sorted(counts.items()))}")
    found = figures(outcomes)
    print(found)
    for half in (0, 1):
        print(f"  half {half}: {figures([one for one in outcomes if one.half == half])}")
    if arguments.v:
        for name in ("wrong", "rejected", "far"):
            print(f"{name}:")
            for one in getattr(found, name):
                if arguments.half in {None, one.half}:
                    print(f"  {one}")
    return 0 if found.are_met else 1


if __name__ == "__main__":
    sys.exit(main())
