"""calibrary.compare: two calibrations or two files, and what lies between them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import calibrary
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.jobs.diff.verdicts import Kind
from calibrary.records import replace
from calibrary.schemas import require
from tests.workshop import CAMERA


def moved() -> calibrary.Calibration:
    """The same camera with a focal length 1 % longer."""
    K = CAMERA.intrinsics
    return replace(CAMERA, intrinsics=replace(K, fx=K.fx * 1.01, fy=K.fy * 1.01))


def test_files_and_calibrations_may_be_mixed(furnished: Path) -> None:
    change = calibrary.compare(furnished / "camera.xml", CAMERA)
    assert change.verdict is ChangeVerdict.IDENTICAL
    assert not change.alarm
    assert change.structural == ()


def test_a_moved_focal_length_is_a_drift_with_its_numbers() -> None:
    change = calibrary.compare(CAMERA, moved())
    assert change.verdict is ChangeVerdict.DRIFT
    assert change.alarm
    assert change.reasons
    assert change.numbers is not None
    assert change.numbers.focal_change == pytest.approx(0.01)


@pytest.mark.parametrize(("factor", "verdict"), [(1.01, "explains"), (1.053, "does not explain")])
def test_how_well_each_side_is_known_is_told_where_one_is_nominal(factor: float, verdict: str) -> None:
    K = CAMERA.intrinsics
    nominal = replace(
        CAMERA,
        grade=calibrary.Grade.DERIVED,
        quality=None,
        intrinsics=replace(K, fx=K.fx * factor, fy=K.fy * factor),
    )
    [told] = [one for one in calibrary.compare(nominal, CAMERA).reasons if "the focal length is known" in one]
    assert told.startswith("the focal length is known of A (derived) to ±3%, B (calibrated) to ±")
    assert told.endswith(f"which {verdict} the image scale")


def test_a_change_of_kind_is_named() -> None:
    lens = CAMERA.distortion
    assert lens is not None
    swapped = replace(
        CAMERA, distortion=replace(lens, p1=lens.coefficients["p2"], p2=lens.coefficients["p1"])
    )
    change = calibrary.compare(CAMERA, swapped)
    assert change.verdict is ChangeVerdict.STRUCTURAL
    assert [cause.kind for cause in change.structural] == [Kind.TANGENTIAL_SWAP]


def test_the_policys_limits_make_the_alarm(tmp_path: Path) -> None:
    limits = "drift_focal: 0.05\ndrift_rms_px: 500\ndrift_max_px: 500\n"
    (tmp_path / "lenient.yaml").write_text(f"schema: calibrary/policy-1\nname: lenient\n{limits}")
    assert not calibrary.compare(CAMERA, moved(), policy=tmp_path / "lenient.yaml").alarm


def test_it_is_plain_data_by_the_commands_schema() -> None:
    document = calibrary.compare(CAMERA, CAMERA, altitude_m=60.0).to_dict()
    require(json.loads(json.dumps(document, allow_nan=False)), "diff-1", source="to_dict")
