"""``calibrary calibrate --rig``: calibrate the lenses and relative poses of cameras that form a rig."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.keeping import add_keeping_flags, check_keeping, keep
from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.calibrate_rig import calibrate_rig
from calibrary.probability import two_digits

if TYPE_CHECKING:
    from rich.text import Text

    from calibrary.jobs.calibrate_rig.report import RigReport
    from calibrary.rig import RigPose

DESCRIPTION = """\
Compute K and distortion of every camera of a rig and their poses relative to one another, in one adjustment.

FRAMES are folders, one for each camera, in which frames of one shot have the same name or number; or a folder or
files whose names state camera and shot: MicaSense (IMG_0001_1.tif), P4 Multispectral, Mavic 3 Multispectral, Sequoia,
left01/right01, or as --pattern states. If only one camera shows the board in a shot, that frame serves the lens of that
camera. It says for each camera and for the rig whether it may be kept FIXED, is a START, or good for NONE.
"""
EXAMPLES = """\
examples:
  calibrary calibrate --rig left/ right/ --board checkerboard:11x8 --square-mm 40 --html rig.html
  calibrary calibrate --rig SET/ --square-mm 40 --reference 5 --out rig_config.json
  calibrary calibrate --rig 'shots/*.png' --pattern '{shot}_{camera}.png' --square-mm 40 --out camchain.yaml
  calibrary calibrate --rig left/ right/ --square-mm 40 --compare extrinsics.yml --corners corners/
  calibrary calibrate --rig --from corners/rig.json --registry ../fleet --rig-name mapper-2

exit codes: 0 FIXED; 1 START or NONE, no board, or an error of the registry's check; 3 unreadable input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        calibrate_rig,
        positional={"frames": "FRAMES"},
        spelled={"corners": "--from", "keep_corners": "--corners"},
        without=("tool",),
        groups={
            "which frames belong together": ("pattern", "in_order", "reference", "corners"),
            "the board": ("board", "square_mm", "marker_mm"),
            "how to solve": ("lens_model", "flat", "focus", "workers"),
            "what is written": ("html", "keep_corners", "out", "to", "compare"),
            "the registry": ("registry", "rig_name"),
        },
    )
    add_keeping_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.calibrate.display import exit_code, show_files, show_findings_of, show_outcome
    from calibrary.cli.console import note, plain, printable
    from calibrary.cli.registry.changes import screen_of_change
    from calibrary.cli.tables import facts

    check_keeping(arguments)
    with Bar(note(arguments), "finding the board in") as bar:
        report = call(calibrate_rig, arguments, progress=bar)
    screen = screen_of_change(arguments)
    for remark in report.notes:
        note(arguments).say(f"[dim]note[/]: {plain(remark)}")
    width = screen.width - 2
    screen.show(_cameras(report, width), indent=2)
    for name, pose in report.poses.items():
        screen.say("")
        screen.say(f"  {plain(name)} before {plain(report.reference)}")
        screen.show(_pose(pose, width - 2), indent=4)
    screen.say("")
    screen.show(facts([(name, printable(text)) for name, text in _facts(report)], width), indent=2)
    show_files(screen, arguments, report.unwritten)
    kept = keep(arguments, screen, report.verdict, lambda: report.entries)
    screen.say("")
    show_findings_of(screen, report.findings)
    show_outcome(
        screen,
        report.verdict,
        f"rig of {len(report.cameras)} cameras, {len(report.shots)} shots that two or more share, paired "
        f"{plain(report.pairing)}",
    )
    if arguments.json:
        print_json(report, indent=None)
    return exit_code(report.verdict, report.unwritten, kept=kept)


def _cameras(report: RigReport, width: int) -> list[Text]:
    from calibrary.calibration import Quality
    from calibrary.cli.calibrate.display import STYLES
    from calibrary.cli.console import plain
    from calibrary.cli.tables import Column, fitted

    columns = (
        Column(name="camera"),
        *(Column(name=name, right=True) for name in ("fx ± σ·κ", "cx ± σ·κ", "cy ± σ·κ", "RMS px", "views")),
        Column(name="verdict", rank=1, wraps=True),
    )
    rows: list[tuple[str, ...]] = []
    for camera in report.cameras:
        one = camera.result
        K, quality = one.calibration.intrinsics, one.calibration.quality or Quality()
        wider = math.sqrt(quality.inflation)
        values = [
            f"{getattr(K, key):.2f} ± {two_digits(quality.std.get(key, math.nan) * wider)}"
            for key in ("fx", "cx", "cy")
        ]
        reasons = ", ".join(f.rule for f in one.findings if f.severity != "note")
        verdict = f"[{STYLES[one.verdict]}]{one.verdict}[/]" + (f": {reasons}" if reasons else "")
        rows.append((plain(camera.name), *values, f"{quality.rms_px:.3f}", str(quality.views), verdict))
    return fitted(columns, rows, width)


def _pose(pose: RigPose, width: int) -> list[Text]:
    from calibrary.cli.tables import Column, fitted

    columns = (
        Column(name=""),
        *(Column(name=name, right=True) for name in ("rotation °", "± °", "translation mm", "± mm")),
    )
    turn, shift = pose.rotation_std_deg, pose.translation_std_mm
    rows = [
        (
            axis,
            f"{pose.rotation_deg[at]:+.4f}",
            f"{turn[at]:.4f}" if turn is not None else "–",
            f"{pose.translation_mm[at]:+.3f}",
            f"{shift[at]:.3f}" if shift is not None else "–",
        )
        for at, axis in enumerate("xyz")
    ]
    spread = f"{pose.baseline_std_mm:.3f}" if pose.baseline_std_mm is not None else "–"
    rows.append(("in all", f"{pose.angle_deg:.4f}", "", f"{pose.baseline_mm:.3f}", spread))
    return fitted(columns, rows, width)


def _facts(report: RigReport) -> Iterator[tuple[str, str]]:
    for name, (near, far) in report.cross_std_px.items():
        sigmas = " and ".join(
            f"{two_digits(value)} px {where}"
            for value, where in ((near, "at the boards' distance"), (far, "far away"))
            if value
        )
        yield (
            f"{name} predicted",
            f"from the reference camera's pixels with a σ of {sigmas or 'nothing in common'}",
        )
    if report.kappa2 is not None:
        yield "variance factor", f"{report.kappa2:.2f} of the poses, between halves of the shots"
    if report.excess_px is not None:
        yield "one pose for all", f"adds {report.excess_px:.3f} px to the residuals"
    for what, found in (("metadata state", report.stated), ("compared", report.compared)):
        for one in found:
            shift = f", {one.translation_mm:.2f} mm away" if one.translation_mm is not None else ""
            yield what, f"{one.camera} turned by {one.rotation_deg:.3f}°{shift}"
