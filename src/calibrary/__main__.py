"""The command ``calibrary``, also as ``python -m calibrary``."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line so that a signal ends it in order at any moment; returns the exit code."""
    # The matrices of an adjustment are small: OpenBLAS's other threads wait for work in a loop, which takes three times
    # the CPU time and, on a busy machine, twice the time. It reads this when numpy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from calibrary.cli.signals import exit_code, listen, stop_listening

    try:
        listen()
        from calibrary.cli.main import main as command

        return command()
    except KeyboardInterrupt as error:
        sys.stderr.write("calibrary: interrupted; nothing was half written\n")
        return exit_code(error)
    finally:
        stop_listening()


if __name__ == "__main__":
    sys.exit(main())
