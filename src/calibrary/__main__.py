"""The command ``calibrary``, also as ``python -m calibrary``."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line so that a signal ends it in order at any moment; returns the exit code."""
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
