"""``calibrary desk``: work with a registry in a browser on this machine."""

from __future__ import annotations

import argparse
import sys

from calibrary.cli.flags import call
from calibrary.cli.shown import Shown
from calibrary.jobs.desk import desk

DESCRIPTION = (
    "Open a registry in the browser of this machine: which K to use for a camera or an image, on which day, and why, "
    "as a file of any program; whether the K's of a flight are right; what K a new payload or frames of a board "
    "give; whether K moved; what waits, to approve or reject it beside what is in use. It fetches nothing and works "
    "offline; each page shows the command that does the same."
)
EXAMPLES = """\
examples:
  calibrary desk                                opens the browser; Ctrl-C ends it
  calibrary desk --registry fleet/ --no-open    prints the address to open, which has a token in it
  calibrary desk --port 8710
  calibrary desk --host 192.168.1.20 --let-others-act-as-me --password-file desk.txt

It answers only this machine, and only who has the address that it prints: the desk works as you, with your git identity
and key. With --host whoever has the password does.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note

    server = call(desk, arguments)
    sys.stdout.write(f"{server.address}\n")
    sys.stdout.flush()
    note(arguments).say("Ctrl-C ends it")
    import webbrowser

    try:
        server.run(None if arguments.no_open else webbrowser.open)
    except KeyboardInterrupt:
        note(arguments).say("ended")
    return 0


COMMAND = Shown(
    desk,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    groups={"for others than this machine": ["host", "let_others_act_as_me", "password_file"]},
    switches={"--no-open": "print the address, and open no browser"},
    json=False,
)
