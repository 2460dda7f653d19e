"""The one way a benchmark measures, and says what it found.

Time is that of the processor, of this process and of those it started, user and system: what a machine that does
other things besides changes little. Contestants take turns, so that what it does change hits them all.

A row is a line ``measure | ours | peer | ratio | limit | met``; ``python -m benchmarks.run`` gathers those of every
benchmark into docs/performance.md.
"""

from __future__ import annotations

import os
import platform
import resource
import time
from collections.abc import Callable, Mapping
from statistics import median
from typing import NamedTuple

SEPARATOR = " | "


class Row(NamedTuple):
    """One line of the table, as text; what there is not is empty.

    Attributes:
        measure: what was measured.
        ours: with its unit.
        peer: with its unit, and who it is.
        ratio: of the two.
        limit: of the ratio, or of ours.
        met: "yes" or "no".
    """

    measure: str
    ours: str
    peer: str = ""
    ratio: str = ""
    limit: str = ""
    met: str = ""


class Cost(NamedTuple):
    """Seconds of the processor, and of the clock."""

    cpu_s: float
    wall_s: float


def cost_of(act: Callable[[], object]) -> Cost:
    """What doing something once costs, the processes it starts and waits for included."""
    cpu, wall = _cpu_s(), time.perf_counter()
    act()
    return Cost(_cpu_s() - cpu, time.perf_counter() - wall)


def in_turns(contestants: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[Cost]]:
    """The costs of every contestant, one after the other in each turn."""
    costs: dict[str, list[Cost]] = {name: [] for name in contestants}
    for _ in range(repeats):
        for name, act in contestants.items():
            costs[name].append(cost_of(act))
    return costs


def compared(
    measure: str,
    ours: list[float],
    peer: list[float],
    *,
    scale: float,
    unit: str,
    name: str,
    most: float | None = None,
    least: float | None = None,
) -> None:
    """A row of costs measured in turns; the median of their ratios counts.

    Args:
        measure: what was measured.
        ours: the costs.
        peer: the costs of the same turns.
        scale: of both, into the unit.
        unit: they are shown in.
        name: the peer's.
        most: how many times the peer's cost ours may be.
        least: how many times ours the peer's cost shall be; the ratio is then peer : ours.
    """
    pairs = [(a, b) if least is None else (b, a) for a, b in zip(ours, peer, strict=True)]
    ratio = median(a / b for a, b in pairs)
    limit = f"≥ {least:g} ×" if least is not None else f"≤ {most:g} ×" if most is not None else ""
    good = ratio >= least if least is not None else ratio <= most if most is not None else None
    shown = f"{median(ours) * scale:.3g} {unit}", f"{median(peer) * scale:.3g} {unit} ({name})"
    show(measure, *shown, ratio=f"{ratio:.3g} ×", limit=limit, met=good)


def row(
    measure: str,
    shown: str,
    measured: float | None = None,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
) -> None:
    """A row of a figure that is shown in its own way; one with a limit says whether it is met."""
    if measured is not None and at_most is not None:
        show(measure, shown, limit=f"≤ {at_most:g}", met=measured <= at_most)
    elif measured is not None and at_least is not None:
        show(measure, shown, limit=f"≥ {at_least:g}", met=measured >= at_least)
    else:
        show(measure, shown)


def at_most(measure: str, value: float, unit: str, limit: float) -> None:
    """A row with nothing to compare, which is to be small."""
    show(measure, f"{value:.3g} {unit}", limit=f"≤ {limit:g} {unit}", met=value <= limit)


def at_least(measure: str, value: float, unit: str, limit: float) -> None:
    """The same for what is to be large."""
    show(measure, f"{value:.3g} {unit}", limit=f"≥ {limit:g} {unit}", met=value >= limit)


def show(
    measure: str, ours: str, peer: str = "", *, ratio: str = "", limit: str = "", met: bool | None = None
) -> None:
    """Print a row."""
    row = Row(measure, ours, peer, ratio, limit, {True: "yes", False: "no", None: ""}[met])
    print(SEPARATOR.join(cell.replace("|", "/").strip() for cell in row), flush=True)


def machine() -> str:
    """What is measured on, as a sentence's part."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:  # noqa: PTH123  one line of a pseudo-file
            model = next(
                (line.partition(":")[2].strip() for line in file if line.startswith("model name")), model
            )
    except OSError:
        pass
    return (
        f"{model}, {os.cpu_count()} processors, {platform.system()}, Python {platform.python_version()}, "
        f"load {os.getloadavg()[0]:.1f}"
    )


def _cpu_s() -> float:
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime
