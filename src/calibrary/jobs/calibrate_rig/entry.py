"""The registry entries of a rig: one for each camera, with its pose in the rig."""

from __future__ import annotations

from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError
from calibrary.jobs.calibrate.entry import entry_of
from calibrary.jobs.calibrate.run import SolveRequest
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.rig import RigMember

__all__ = ["rig_entries"]


def rig_entries(result: RigResult, request: SolveRequest, name: str) -> tuple[Entry, ...]:
    """Make draft entries, that of the reference camera first.

    Args:
        result: of the rig.
        request: options of the solve.
        name: of the rig, such as the hash of its serial number or its name in the fleet.

    Raises:
        InputError: the rig was refused, or the make or model of a camera is unknown.
    """
    if result.verdict is BoardVerdict.REFUSE:
        raise InputError("a rig that was refused becomes no entries; its report says what to do")
    entries = [
        replace(
            entry_of(one, request),
            rig=RigMember(rig=name, camera=camera, reference=result.reference, pose=result.poses.get(camera)),
        )
        for camera, one in result.cameras.items()
    ]
    ids = [entry.id for entry in entries]
    if len(set(ids)) < len(ids):
        raise InputError(
            f"two cameras of the rig would have one entry, {ids[0]}; expected names that distinguish them"
        )
    return tuple(entries)
