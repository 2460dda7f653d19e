"""Every benchmark in its quick form, and what they found as one table in docs/performance.md.

    python -m benchmarks.run [NAME …]

A benchmark prints rows by :mod:`benchmarks.table`; what one prints in lines of its own stands on the screen alone. The
page has the rows beside a peer, missed limits first, and one for many alike. A benchmark that fails, or takes too long,
is named with the last line that it said; the others go on. With names, only those are run, and the page is left alone.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from benchmarks.table import SEPARATOR, Row, machine

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "performance.md"
BEGIN, END = "<!-- make bench writes from here -->\n", "<!-- to here -->\n"
LONGEST_S = 300
FEW = 3
NUMBER = re.compile(r"[\d.]+(?:e[+-]?\d+)?")
SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}

QUICK: dict[str, tuple[str, ...]] = {
    "startup": ("--quick",),
    "extract": ("--images", "500", "--repeats", "3"),
    "registry_entries": ("--entries", "1000", "--repeats", "3"),
    "publish": ("--entries", "2000", "--resolves", "500"),
    "parsers": ("--repeats", "3"),
    "geometry": ("--rounds", "5"),
    "detection": ("--frames", "2"),
    "calibration": ("--views", "25", "100"),
    "flight_cost": ("--images", "8"),
}
"""By area, the benchmark's name: what makes it quick."""


class Outcome(NamedTuple):
    """What one benchmark said.

    Attributes:
        rows: of the table.
        lines: what else it printed, where it prints no rows.
        failure: why it did not come to its end; "" where it did.
        seconds: of the clock.
    """

    rows: tuple[Row, ...]
    lines: tuple[str, ...]
    failure: str
    seconds: float


def outcome_of(area: str) -> Outcome:
    """Run one benchmark."""
    start = time.perf_counter()
    command = [sys.executable, "-m", f"benchmarks.{area}", *QUICK[area]]
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
            env=_as_installed(),
        )
        printed, complaint = done.stdout, done.stderr.strip().rpartition("\n")[2]
        # 1 is a missed limit, which the rows say, or an exception.
        is_broken = done.returncode not in {0, 1} or "Traceback (most recent call last)" in done.stderr
        failure = (complaint or f"exit code {done.returncode}") if is_broken else ""
    except subprocess.TimeoutExpired as error:
        printed, failure = (error.stdout or b"").decode(), f"stopped after {LONGEST_S} s"
    lines = [line.rstrip() for line in printed.splitlines() if line.strip()]
    cells = [line.split(SEPARATOR.rstrip()) for line in lines]
    rows = tuple(Row(*(cell.strip() for cell in found)) for found in cells if len(found) == len(Row._fields))
    return Outcome(rows, () if rows else tuple(lines), failure, time.perf_counter() - start)


def _as_installed() -> dict[str, str]:
    """Return the environment, in which Python keeps its compiled modules, as an installation has them."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def shown(rows: Sequence[tuple[str, Row]]) -> list[tuple[str, Row]]:
    """Return what the page shows: rows beside a peer, missed limits first; of many alike the worst one."""
    alike: dict[tuple[bool, str, str, str], list[Row]] = {}
    for area, row in rows:
        if row.ratio:
            alike.setdefault((row.met != "no", area, row.measure.split(" ")[0], row.limit), []).append(row)
    found = []
    for (_, area, _, limit), same in sorted(alike.items(), key=lambda item: not item[0][0], reverse=True):
        if len(same) <= FEW or not limit:
            found += [(area, row) for row in same]
        else:
            worst = max(same, key=share_of_limit)
            found.append((area, worst._replace(measure=f"{worst.measure}, the worst of {len(same)} alike")))
    return found


def share_of_limit(row: Row) -> float:
    """How much of its limit a row uses; above 1 it is missed."""
    bound, _, limit = row.limit.partition(" ")
    shown = row.ratio if limit.endswith("×") else row.ours
    numbers = [float(found[0]) if (found := NUMBER.search(text)) else 1.0 for text in (shown, limit)]
    share = SECONDS.get(_unit(shown), 1.0) * numbers[0] / (SECONDS.get(_unit(limit), 1.0) * numbers[1])
    return 1.0 / share if bound == "≥" else share


def _unit(text: str) -> str:
    return text.partition(" ")[2]


def page_of(outcomes: dict[str, Outcome]) -> str:
    """The generated part of the page."""
    rows = [(area, row) for area, found in outcomes.items() for row in found.rows]
    text = f"Measured on {datetime.now(UTC):%Y-%m-%d} by `make bench`: {machine()}.\n\n"
    limited = [row for _, row in rows if row.met]
    text += f"{sum(row.met == 'yes' for row in limited)} of {len(limited)} limits are met.\n\n"
    text += "| area | measure | ours | peer | ratio | limit | met? |\n| --- | --- | --- | --- | --- | --- | --- |\n"
    text += "".join(f"| {' | '.join((area, *row))} |\n" for area, row in shown(rows))
    for area, found in outcomes.items():
        if found.failure:
            text += f"\n`{area}` did not come to its end: {found.failure}\n"
    return text


def main() -> None:
    """Run, print, and write the page."""
    parser = argparse.ArgumentParser(description="Every benchmark in its quick form.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(QUICK)}")
    names = parser.parse_args().names
    if unknown := set(names) - QUICK.keys():
        parser.error(f"{', '.join(sorted(unknown))}: wanted some of {', '.join(QUICK)}")
    outcomes: dict[str, Outcome] = {}
    for area in names or QUICK:
        print(f"{area} …", flush=True)
        found = outcomes[area] = outcome_of(area)
        for line in (*map(SEPARATOR.join, found.rows), *found.lines):
            print(f"  {line}")
        print(f"  {found.seconds:.0f} s{f', failed: {found.failure}' if found.failure else ''}", flush=True)
    if not names:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        PAGE.write_text(f"{before}{BEGIN}\n{page_of(outcomes)}\n{END}{after}", encoding="utf-8")
        print(f"written: {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
