"""Feed a reader one file that the fuzzer found, and say what it does: ``python -m fuzz.replay TARGET FILE``.

Exit code 1 when it breaks its promise: an error that is none of calibrary's own, a warning, more than two
seconds, or more than 512 MiB.
"""

from __future__ import annotations

import contextlib
import sys
import time
import traceback
import warnings
from pathlib import Path

from fuzz.target import MAX_GROWTH_MIB, MAX_SECONDS, target_named

STATUS = Path("/proc/self/status")


def peak_mib() -> float:
    """The most memory this process ever held; 0 where there is no /proc to say it."""
    if not STATUS.exists():
        return 0.0
    [peak] = [line.split()[1] for line in STATUS.read_text().splitlines() if line.startswith("VmHWM")]
    return int(peak) / 1024


def main() -> int:
    """Read the file once."""
    name, path = sys.argv[1:]
    data = Path(path).read_bytes()
    target = target_named(name)
    warnings.simplefilter("error")
    # What a first file loads into memory is no fault of the second.
    with contextlib.suppress(Exception):
        target(data[: len(data) // 2])
    before, start = peak_mib(), time.process_time()
    broken = False
    try:
        target(data)
    except Exception:  # noqa: BLE001  to show it is what this is for
        traceback.print_exc()
        broken = True
    seconds, growth_mib = time.process_time() - start, peak_mib() - before
    print(f"{seconds:.2f} s, {growth_mib:.0f} MiB")
    return int(broken or seconds > MAX_SECONDS or growth_mib > MAX_GROWTH_MIB)


if __name__ == "__main__":
    sys.exit(main())
