"""The command ``calibrary``, also as ``python -m calibrary``."""

from __future__ import annotations

import os
import sys


def main() -> int:
    """Run the command line and return its exit code; a signal ends it cleanly at any moment."""
    # The matrices of an adjustment are small. OpenBLAS's extra threads would wait for work in a busy loop: three times
    # the CPU time and, on a busy machine, twice the elapsed time. OpenBLAS reads this when numpy is loaded.
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
