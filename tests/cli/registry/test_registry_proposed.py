"""What lacks an approval: no reader hands out its K, and each says who proposed it, what it lacks and what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from calibrary.errors import CalibraryError
from calibrary.jobs.extract import extract
from calibrary.jobs.fleet import Fleet
from tests.cli.registry.fleets import P4R, add, looked_at, run, xml
from tests.cli.registry.test_registry_approvals import asks
from tests.jobs.extract.fleet import picture

FX: Final = "3660.5"
SAID: Final = f"{P4R} is proposed by Ada Keeper and not approved, so not used: it lacks 1 of 2 approvals"

Said = tuple[object, str]
"""The K that a reader hands out, and its words."""


def refusal(act: Callable[[], object]) -> Said:
    try:
        return act(), ""
    except CalibraryError as error:
        return None, str(error)


def resolve(fleet: Path, _: Path) -> Said:
    found = Fleet(fleet).resolve(P4R)
    return found.calibration, " ".join(one.reason for one in found.near)


def show(fleet: Path, _: Path) -> Said:
    shown = Fleet(fleet).show(P4R)
    return None if shown.use == "none" else shown.use, shown.use_reason or ""


def listed(fleet: Path, _: Path) -> Said:
    found = Fleet(fleet).listing()
    [row] = found.chosen.rows
    return row["status"] if row["status"] == "approved" else None, " ".join(found.notes)


def lock_one(fleet: Path, out: Path) -> Said:
    return refusal(lambda: Fleet(fleet).lock([P4R], out=out / "lock"))


def lock_all(fleet: Path, out: Path) -> Said:
    return refusal(lambda: Fleet(fleet).lock(out=out / "lock"))


def export(fleet: Path, out: Path) -> Said:
    return refusal(lambda: Fleet(fleet).export(out / "all.csv"))


def extracted(fleet: Path, out: Path) -> Said:
    (out / "flight").mkdir()
    picture(out / "flight/a.jpg", (5472, 3648), make="DJI", model="FC6310R")
    [one] = extract([out / "flight"], registry=fleet, dry_run=True, workers=1).judged
    why = " ".join(step.why for step in one.fallback.steps) if one.fallback is not None else ""
    is_its = one.calibration is not None and str(one.calibration.intrinsics.fx) == FX
    return one.calibration if is_its else None, why


READERS: Final[dict[str, Callable[[Path, Path], Said]]] = {
    "resolve, Python": resolve,
    "show": show,
    "list": listed,
    "lock of it": lock_one,
    "lock of all": lock_all,
    "export": export,
    "extract": extracted,
}


@pytest.fixture
def waiting(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A registry with the K of one camera, which one of two people has approved."""
    asks(fleet, "approvals: {count: 2}\n", capsys)
    add(xml(tmp_path / "a.xml"), "--approve")
    capsys.readouterr()
    return fleet


@pytest.mark.parametrize("reader", READERS)
def test_it_is_not_handed_out_and_what_to_do_is_said(reader: str, waiting: Path, tmp_path: Path) -> None:
    K, words = READERS[reader](waiting, tmp_path)
    _, _, digest, *_ = looked_at(waiting, P4R)
    assert K is None
    assert f"{SAID}; 'calibrary registry approve {P4R} --digest {digest[:12]}' approves it" in words


@pytest.mark.usefixtures("waiting")
def test_the_terminal_says_it(capsys: pytest.CaptureFixture[str]) -> None:
    for words, code in ((["resolve", P4R], 4), (["list"], 0), (["show", P4R], 0), (["lock", P4R], 4)):
        found, out, err = run(capsys, *words)
        assert (found, SAID in " ".join((out + err).split())) == (code, True), words


@pytest.mark.parametrize("key", ["P4R-03", "0V2LG3H0"])
def test_a_unit_that_is_only_proposed_goes_by_its_label_and_serial_number(
    fleet: Path, tmp_path: Path, key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--serial", "0V2LG3H0", "--label", "P4R-03")
    code, _, err = run(capsys, "resolve", key)
    assert (code, "is proposed by Ada Keeper and not approved" in " ".join(err.split())) == (4, True)
    assert run(capsys, "approve", *looked_at(fleet, key))[0] == 0
    assert run(capsys, "resolve", key)[0] == 0
