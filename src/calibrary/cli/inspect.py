"""``calibrary inspect``: show what a calibration file or image is, how it was recognised, and what it contains."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.shown import Shown
from calibrary.jobs.inspect import inspect
from calibrary.jobs.tables import files

if TYPE_CHECKING:
    from calibrary.jobs.inspect.run import InspectFilesReport

DESCRIPTION = "Show what a calibration file or image is, how calibrary recognised it, and what it contains."
EXAMPLES = """\
examples:
  calibrary inspect camera.xml                          what it is, K, distortion, conventions
  calibrary inspect flight/DJI_0001.JPG                 what an image states about its camera
  calibrary inspect flight/DJI_0001.JPG --tags          every EXIF tag of an image, MakerNote included
  calibrary inspect K.npy --image-size 5472x3648
  calibrary inspect handed-over/ --json                 every file of a folder, for machines
  calibrary inspect handed-over/ --table handed-over.csv

exit code 0: every file was read; 1: the same, but a K is hardly a camera's; 3: a file was not read.
"""


class _Inspect(Shown):
    def check(self, arguments: argparse.Namespace) -> None:
        if arguments.tags and arguments.table:
            arguments.parser.error("--table is a table of calibrations; --tags lists tags instead")
        super().check(arguments)

    def print_document(self, done: InspectFilesReport, arguments: argparse.Namespace) -> None:
        """Print the result; one file alone has a document of its own."""
        from msgspec.structs import asdict

        from calibrary.jobs.inspect.run import InspectReport

        alone = len(arguments.files) == 1 and not Path(arguments.files[0]).is_dir()
        print_json(InspectReport(**asdict(done.files[0])) if alone else done)


COMMAND = _Inspect(
    inspect,
    DESCRIPTION,
    EXAMPLES,
    positional={"files": "FILE"},
    without=["camera"],
    doing="inspecting",
    exits={"is_read": 3, "is_plausible": 1},
    table=("the calibrations", files),
)
