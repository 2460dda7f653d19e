"""Did K move? Two calibrations of one camera, or a fleet's entries then and now: in numbers, in pixels, on the ground.

>>> from calibrary.jobs.diff import compare
>>> change = compare("camera.xml", "survey/DJI_0002.JPG")
>>> change.verdict, change.alarm
(<ChangeVerdict.IDENTICAL: 'identical'>, False)
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import CalibrationLike, File, PolicyLike, Reading, Text
from calibrary.errors import UsageError
from calibrary.policy import FLEET
from calibrary.progress import Progress, labelled

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import DiffReport
    from calibrary.jobs.diff.fleet import FleetDiffReport
    from calibrary.registry.registry import Registry

__all__ = ["compare", "compare_fleet"]


def compare(
    a: CalibrationLike,
    b: CalibrationLike,
    *,
    altitude_m: Annotated[float, Meta(gt=0)] = 100.0,
    policy: PolicyLike = FLEET,
    html: File | None = None,
    registry: Annotated[str | Path, Meta(title="PATH")] | None = None,
    reading: Reading | None = None,
) -> DiffReport:
    """Compare a later calibration with an earlier one of the same camera.

    Args:
        a: the earlier one: a calibration, a file of any format, an image, or KEY[@REV] of a registry.
        b: the later one; if a file states no image size, that of the other is used.
        altitude_m: flying height above ground, for lengths on the ground, in m.
        policy: policy with the limits for an alarm.
        html: also write a page with maps of the difference.
        registry: the registry of a KEY; see calibrary registry --help for the default.
        reading: settings for the files; a ``camera`` of two names with a comma is one for each side.

    Raises:
        InputError: a file cannot be read, or a K is not in pixels.
        CalibrationError: the common field of view is too small.
        RegistryError: neither a file nor an entry has the name.
    """
    from calibrary.admission import admission
    from calibrary.jobs.diff import comparison
    from calibrary.jobs.files import read_arguments
    from calibrary.pages import check_page_place, write_page
    from calibrary.policy_file import policy_of

    place = check_page_place(html)
    one, two = read_arguments(a, b, reading or Reading(), Path(registry) if registry is not None else None)
    found = comparison.compare(
        one.calibration,
        two.calibration,
        policy_of(policy),
        labels=(one.label, two.label),
        altitude_m=altitude_m,
    )
    doubts = [
        f"{side.label} is an unlikely K: {doubt.message}"
        for side in (one, two)
        if (doubt := admission(side.calibration)) is not None
    ]
    if doubts:
        found = found.doubted(doubts)
    if place is not None:
        from calibrary.jobs.diff.told import told

        write_page(place, told(found, altitude_m))
    return found


def compare_fleet(
    registry: Registry,
    *,
    since: Annotated[str, Meta(title="REV")] | None = None,
    firmware: Annotated[str, Meta(title="OLD..NEW")] | None = None,
    altitude_m: Annotated[float, Meta(gt=0)] = 100.0,
    policy: PolicyLike = FLEET,
    html: Text | Path | None = None,
    progress: Progress | None = None,
) -> FleetDiffReport:
    """Compare the entries of a registry with their earlier state, or those of one firmware with those of another.

    Proposals are compared as well.

    Args:
        registry: the registry.
        since: compare the registry with its state at a commit, tag or day.
        firmware: compare entries of one firmware with those of another; 01.09 is each whose number begins so.
        altitude_m: as of :func:`compare`.
        policy: as of :func:`compare`.
        html: also write a page with all changes.
        progress: called with (entries done, number of entries, "entries").

    Raises:
        UsageError: not one of ``since`` and ``firmware`` is given, or the latter is no OLD..NEW.
        RegistryError: there is no such revision, or the registry cannot be read.
    """
    from calibrary.jobs.diff import fleet
    from calibrary.pages import check_page_place, write_page
    from calibrary.policy_file import policy_of

    old, _, new = (firmware or "").partition("..")
    if (since is None) == (firmware is None):
        raise UsageError("expected --since REV or --firmware OLD..NEW, and one of them only")
    if firmware is not None and not (old and new):
        raise UsageError(f"--firmware {firmware}: expected OLD..NEW, such as 01.08..01.09")
    place, reported = check_page_place(html), labelled(progress, "entries")
    if since is not None:
        found, title = fleet.since(registry, since, policy_of(policy), reported), f"The fleet since {since}"
    else:
        found = fleet.by_firmware(registry, old, new, policy_of(policy), reported)
        title = f"The fleet from firmware {old} to {new}"
    if place is not None:
        from calibrary.jobs.diff.told import told_fleet

        write_page(place, told_fleet(found, title, altitude_m))
    return found
