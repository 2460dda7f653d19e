"""``calibrary convert``: convert calibration files to another program's format, and report what was lost."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.shown import Shown
from calibrary.jobs.convert import convert

if TYPE_CHECKING:
    from calibrary.jobs.convert.run import ConvertReport

DESCRIPTION = "Write a calibration in another program's format, and report what was kept."
EXAMPLES = """\
examples:
  calibrary convert camera.xml camera.yml --to opencv
  calibrary convert K.npy cameras.txt --to colmap --image-size 5472x3648
  calibrary convert rig.xml one.yml --to opencv --camera 2
  calibrary convert camera.xml half.yml --to opencv --scale-to 2736x1824
  calibrary convert camera.xml part.yml --to opencv --crop 100,50,4000,3000
  calibrary convert report.txt lens.xml --to metashape --max-error-px 0.2
  calibrary convert camera.xml database.db --into all               into the cameras of a COLMAP database
  calibrary convert rigs/ "old/*.yaml" converted/ --to kalibr       many, each into a file of its own

The output is written only if it holds the calibration to 0.05 px anywhere in the image, or to
--max-error-px. The command names what the format cannot contain.

exit code 0: all were written; 1: the same, but a K is hardly a camera's, and --force was not given;
3: at least one was not written.
"""


class _Convert(Shown):
    def show(self, done: ConvertReport, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, place=arguments.output)

    def exit_code(self, done: ConvertReport, arguments: argparse.Namespace) -> int:
        return 0 if done.is_good and arguments.force else super().exit_code(done, arguments)


COMMAND = _Convert(
    convert,
    DESCRIPTION,
    EXAMPLES,
    positional={"sources": "IN", "output": "OUT"},
    doing="converting",
    exits={"is_good": 3, "is_likely": 1},
)
