"""Two entries field by field."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from calibrary.calibration import Quality
from calibrary.distortion import KannalaBrandt, NoDistortion
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.fields import FieldChange, differences, entry_fields
from tests.registry.entries import an_entry, covariance, entries
from tests.thorough import examples


def changed(before: Entry | None, after: Entry) -> dict[str, FieldChange]:
    return {change.name: change for change in differences(before, after)}


@settings(max_examples=examples(4, 240))
@given(entries())
def test_an_entry_differs_in_nothing_from_itself_and_in_everything_from_none(entry: Entry) -> None:
    assert differences(entry, entry) == ()
    assert [change.name for change in differences(None, entry)] == [*entry_fields(entry)]


@settings(max_examples=examples(4, 240))
@given(entries(), entries())
def test_the_changes_lead_from_one_entry_to_the_other(one: Entry, other: Entry) -> None:
    fields = entry_fields(one)
    for change in differences(one, other):
        assert fields.pop(change.name, None) == change.before
        if change.after is not None:
            fields[change.name] = change.after
    assert fields == entry_fields(other)


def test_the_last_bit_of_a_number_is_a_difference() -> None:
    assert "intrinsics.fx" in changed(an_entry(fx=3661.25), an_entry(fx=3661.2500000000005))


def test_a_difference_is_measured_in_its_own_spread_where_both_know_theirs() -> None:
    one = an_entry(fx=3660.0, quality=Quality(std={"fx": 0.3, "fy": 0.3}))
    other = an_entry(fx=3661.0, quality=Quality(std={"fx": 0.4}))
    fields = changed(one, other)
    assert fields["intrinsics.fx"].z == pytest.approx(2.0)
    assert (fields["intrinsics.fy"].delta, fields["intrinsics.fy"].z) == (1.0, None)


def test_a_covariance_comes_before_a_standard_deviation_by_itself() -> None:
    quality = Quality(covariance=covariance(), std={"fx": 100.0})
    fields = changed(an_entry(fx=3660.0, quality=quality), an_entry(fx=3661.0, quality=quality))
    assert fields["intrinsics.fx"].z == pytest.approx(1 / (covariance().std["fx"] * 2**0.5))


def test_coefficients_of_two_models_are_not_subtracted() -> None:
    fields = changed(an_entry(), an_entry(distortion=KannalaBrandt(k1=0.1, k2=0.0, k3=0.0, k4=0.0)))
    assert fields["distortion.model"].after == KannalaBrandt.model
    assert fields["distortion.k1"].delta is None


def test_unknown_distortion_is_not_none() -> None:
    fields = changed(an_entry(distortion=NoDistortion()), an_entry(distortion=None))
    assert fields["distortion"].after == "unknown"
    assert fields["distortion.model"].after is None


def test_a_field_that_is_gone_stands_where_it_stood() -> None:
    entry = an_entry(tolerance=0.02, supersedes="dji/fc330/4000x3000", reason="checked")
    names = [
        change.name
        for change in differences(entry, replace(entry, reason=None, tolerance=None, supersedes=None))
    ]
    assert names == ["reason", "tolerance", "supersedes"]


def test_a_covariance_that_changed_is_told_without_its_numbers() -> None:
    one, other = (an_entry(quality=Quality(covariance=covariance(seed=seed))) for seed in (1, 2))
    [change] = differences(one, other)
    assert change.name == "quality.covariance.upper"
    assert str(change.after).startswith("15 numbers (")
