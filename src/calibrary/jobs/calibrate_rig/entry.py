"""The entries that a rig becomes: one for each camera, each with its place in the rig."""

from __future__ import annotations

from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import InputError
from calibrary.jobs.calibrate_board.entry import entry_of
from calibrary.jobs.calibrate_board.run import SolveRequest
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.rig import RigMember

__all__ = ["rig_entries"]


def rig_entries(result: RigResult, request: SolveRequest, name: str) -> tuple[Entry, ...]:
    """Drafts, the reference camera's first.

    Args:
        result: of the rig.
        request: how it was solved.
        name: of the rig, such as its serial number's hash or what it is called in the fleet.

    Raises:
        InputError: the rig was refused, or a camera is not known by make and model.
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
