"""The cases of combining, each with what has to come out; one camera is combined, and two are never averaged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Covariance, Grade
from calibrary.jobs.calibrate.run import Told
from calibrary.jobs.combine.report import CombinationReport
from calibrary.jobs.combine.run import COMBINATION
from calibrary.jobs.combine.run import combined as combination
from calibrary.jobs.combine.sources import Source
from calibrary.records import from_json, replace, to_json
from calibrary.sfm.combination import weighted_mean
from tests.jobs.combine.made import NAMES, OTHER, TRUTH, UNIT, made, spread


def combined(*sources: Source) -> CombinationReport:
    return combination(sources, Told())


def flights(count: int, **by: object) -> list[Source]:
    return [made(f"{at}.json", at, **by) for at in range(count)]  # type: ignore[arg-type]


def days(count: int) -> list[str]:
    return [f"{2020 + at}-05-01" for at in range(count)]


def drifting(by_year: float) -> list[Source]:
    return [
        made(f"{day[:4]}.json", at, truth=TRUTH + by_year * at * (OTHER - TRUTH), date=day)
        for at, day in enumerate(days(5))
    ]


def without_covariance(source: Source) -> Source:
    quality = replace(source.quality, covariance=None)
    return replace(source, calibration=replace(source.calibration, quality=quality))


def with_grade(source: Source, grade: Grade) -> Source:
    return replace(source, calibration=replace(source.calibration, grade=grade))


PASS, PROVISIONAL, REFUSE = BoardVerdict
TOO_WIDE = ("provisional: not good enough to be approved", "uncertain-focal-length: 0.2 %", "few-images: 12")
UNSEEN = ("provisional: not good enough to be approved", "uncertain-edge: 7 px; fly cross strips")
FLAT = ("provisional: not good enough to be approved", "focal-length-or-height: flat; fly: two heights")


def surveyed(source: Source) -> Source:
    """A flight with ground control that other flights have too."""
    made_of = replace(
        source.calibration.provenance, assumptions=("the ground control of SHA-256 00 is right",)
    )
    return replace(source, calibration=replace(source.calibration, provenance=made_of))


@dataclass(frozen=True)
class Case:
    """What is given, and what has to come out: the verdict, the rule that decides, and words of its message."""

    name: str
    given: Callable[[], Sequence[Source]]
    verdict: BoardVerdict
    rule: str
    words: str = ""


CASES = (
    Case("two flights", lambda: flights(2), PASS, "consistent", "2 calibrations agree"),
    Case("three flights", lambda: flights(3), PASS, "consistent", "3 calibrations agree"),
    Case("five flights", lambda: flights(5), PASS, "consistent", "5 calibrations agree"),
    Case(
        "σ too small, as far as noise explains it",
        lambda: flights(5, wider=1.25),
        PASS,
        "consistent",
        "σ is multiplied by 1.",
    ),
    Case(
        "σ much too small", lambda: flights(5, wider=3.0), REFUSE, "inconsistent", "so they are not combined"
    ),
    Case(
        "dates far apart, no drift",
        lambda: [made(f"{at}.json", at, date=day) for at, day in enumerate(days(4))],
        PASS,
        "consistent",
        "of 2020-05-01 to 2023-05-01, agree",
    ),
    Case(
        "dates far apart, drift",
        lambda: drifting(0.5),
        REFUSE,
        "drift",
        "from 2020-05-01 to 2024-05-01, at a constant rate",
    ),
    Case(
        "dates far apart, a repair between them",
        lambda: [
            made(f"{at}.json", at, date=day, truth=TRUTH if at < 2 else OTHER)
            for at, day in enumerate(days(5))
        ],
        REFUSE,
        "drift",
        "may have changed between 2021-05-01 and 2022-05-01",
    ),
    Case(
        "two units, one flight each",
        lambda: [made("a.json", 1), made("b.json", 2, truth=OTHER)],
        REFUSE,
        "inconsistent",
        "a.json and b.json disagree by",
    ),
    Case(
        "two flights, a repair between them",
        lambda: [
            made("a.json", 1, date="2024-06-01"),
            made("b.json", 2, truth=OTHER, date="2024-03-01"),
        ],
        REFUSE,
        "inconsistent",
        "If they are of one camera, it changed between 2024-03-01 and 2024-06-01",
    ),
    Case(
        "two units mixed",
        lambda: [*flights(3), made("c.json", 8, truth=OTHER), made("d.json", 9, truth=OTHER)],
        REFUSE,
        "inconsistent",
        "c.json, d.json disagree with 0.json, 1.json, 2.json by",
    ),
    Case(
        "one outlier",
        lambda: [*flights(3), made("odd.json", 7, truth=OTHER)],
        REFUSE,
        "inconsistent",
        "odd.json disagrees with 0.json, 1.json, 2.json by",
    ),
    Case(
        "a small outlier among five",
        lambda: [*flights(4), made("odd.json", 7, truth=TRUTH + 0.5 * (OTHER - TRUTH))],
        REFUSE,
        "inconsistent",
        "odd.json disagrees with",
    ),
    Case(
        "other serial numbers",
        lambda: [
            made("a.json", 1, camera=replace(UNIT, serial="1" * 16)),
            made("b.json", 2, camera=replace(UNIT, serial="2" * 16)),
        ],
        REFUSE,
        "other-camera",
        "serial",
    ),
    Case(
        "another zoom",
        lambda: [
            made("a.json", 1, camera=replace(UNIT, focal_mm=8.8)),
            made("b.json", 2, camera=replace(UNIT, focal_mm=24.0)),
        ],
        REFUSE,
        "other-camera",
        "focal_mm 24.0 and 8.8",
    ),
    Case(
        "another focus",
        lambda: [made("a.json", 1, focus="infinity"), made("b.json", 2, focus="3 m")],
        REFUSE,
        "other-focus",
        "3 m and infinity",
    ),
    Case(
        "another image size",
        lambda: [made("a.json", 1), made("b.json", 2, size=(1500, 844))],
        REFUSE,
        "other-frame",
        "a.json 1500×1000, b.json 1500×844",
    ),
    Case(
        "fewer terms",
        lambda: [made("a.json", 1), made("b.json", 2, model=Solvable.K1K2P1P2)],
        REFUSE,
        "other-lens-model",
        "not all were solved for k3",
    ),
    Case(
        "another lens model",
        lambda: [made("a.json", 1), made("b.json", 2, model=Solvable.FISHEYE)],
        REFUSE,
        "other-lens-model",
        "BrownConrady, KannalaBrandt",
    ),
    Case(
        "no covariance",
        lambda: [made("a.json", 1), without_covariance(made("b.json", 2))],
        REFUSE,
        "no-covariance",
        "b.json states no covariance",
    ),
    Case(
        "a refused one",
        lambda: [made("a.json", 1), with_grade(made("b.json", 2), Grade.SEED)],
        REFUSE,
        "not-measured",
        "b.json is of grade seed",
    ),
    Case(
        "one file twice",
        lambda: [made("a.json", 1), made("a.json", 1)],
        REFUSE,
        "same-observations",
        "the same file",
    ),
    Case(
        "a copy in another format",
        lambda: [made("a.json", 1), made("b.xml", 1)],
        REFUSE,
        "same-observations",
        "to the last digit",
    ),
    Case(
        "images in common",
        lambda: [made("a.json", 1, frames=("a", "b")), made("b.json", 2, frames=("b", "c"))],
        REFUSE,
        "same-observations",
        "have 1 of the files in common",
    ),
    Case(
        "flights over one surveyed field", lambda: [surveyed(one) for one in flights(3)], PASS, "consistent"
    ),
    Case(
        "provisional for a σ that was too wide",
        lambda: flights(4, notes=TOO_WIDE),
        PASS,
        "consistent",
    ),
    Case(
        "provisional for a geometry they may share",
        lambda: flights(4, notes=FLAT),
        PROVISIONAL,
        "provisional-source",
        "focal-length-or-height",
    ),
    Case(
        "provisional for corners of the frame that none of them may have seen",
        lambda: flights(4, notes=UNSEEN),
        PROVISIONAL,
        "provisional-source",
        "uncertain-edge",
    ),
    Case("a program's own σ", lambda: flights(5, kappa2=None), PROVISIONAL, "formal-sigma", "no halves"),
    Case(
        "a program's own σ, one file", lambda: flights(1, kappa2=None), PROVISIONAL, "formal-sigma", "0.json"
    ),
    Case(
        "one file without any σ",
        lambda: [
            replace(made("a.json", 1), calibration=replace(made("a.json", 1).calibration, quality=None))
        ],
        PROVISIONAL,
        "unknown-uncertainty",
    ),
    Case("one file", lambda: flights(1), PASS, ""),
    Case(
        "σ of each too wide for any use",
        lambda: flights(2, wider=40.0, stated=40.0),
        REFUSE,
        "uncertain-focal-length",
    ),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case) -> None:
    report = combination(case.given(), Told())
    assert report.verdict is case.verdict, report.findings
    if case.rule:
        finding = next(one for one in report.findings if one.rule == case.rule)
        assert case.words in finding.message
    assert (report.calibration is None) is (case.verdict is REFUSE)
    assert from_json(CombinationReport, to_json(report)) == report


def test_the_combined_camera_is_nearer_and_says_so() -> None:
    report = combined(*flights(4))
    assert report.calibration is not None
    quality = report.calibration.quality
    assert quality is not None
    assert quality.covariance is not None
    # Equal covariances: the mean, with half the σ of one.
    np.testing.assert_allclose(quality.covariance.matrix, spread() / 4, rtol=1e-6)
    fx = np.mean([one.calibration.intrinsics.fx for one in flights(4)])
    assert report.calibration.intrinsics.fx == pytest.approx(fx, abs=1e-6)
    assert quality.kappa2 == pytest.approx(report.chi2 / report.dof if report.chi2 and report.dof else None)
    assert (quality.points, quality.views) == (16000, 120)
    made_of = report.calibration.provenance
    assert made_of.kind == COMBINATION
    assert [one.name for one in made_of.sources] == ["0.json", "1.json", "2.json", "3.json"]


def test_a_better_one_counts_for_more() -> None:
    good, poor = made("a.json", 1, stated=1.0), made("b.json", 2, wider=3.0, stated=3.0)
    report = combined(good, poor)
    assert report.calibration is not None
    by = [one.calibration.intrinsics.fx for one in (good, poor)]
    assert report.calibration.intrinsics.fx == pytest.approx((9 * by[0] + by[1]) / 10, abs=1e-6)
    one, two = (row.off_px for row in report.sources)
    assert one == pytest.approx(two, rel=0.05)


def test_the_variance_factor_of_a_source_widens_it() -> None:
    narrow, wide = made("a.json", 1), made("b.json", 2, kappa2=9.0)
    report = combined(narrow, wide)
    assert report.calibration is not None
    by = [one.calibration.intrinsics.fx for one in (narrow, wide)]
    assert report.calibration.intrinsics.fx == pytest.approx((9 * by[0] + by[1]) / 10, abs=1e-6)


def test_the_date_is_the_newest_that_is_known() -> None:
    def date_of(*dates: str | None) -> str | None:
        camera = combined(*[made(f"{at}.json", at, date=day) for at, day in enumerate(dates)]).calibration
        assert camera is not None
        return camera.provenance.date

    assert date_of("2024-05-01", None, "2023-05-01") == "2024-05-01"
    assert date_of(None, None, None) is None


def test_one_focal_length_that_was_solved_for_stays_one() -> None:
    """Metashape without b1: fx and fy are one number, and their covariance is singular."""
    C = spread()
    tie = np.eye(len(NAMES))
    tie[1] = tie[0]
    tied = Covariance.from_matrix(NAMES, (M := tie @ C @ tie.T) / 2 + M.T / 2)

    def one(name: str, seed: int, fy_more: float = 0.0) -> Source:
        source = made(name, seed)
        K = source.calibration.intrinsics
        quality = replace(source.quality, covariance=tied)
        return replace(
            source,
            calibration=replace(
                source.calibration, intrinsics=replace(K, fy=K.fx + fy_more), quality=quality
            ),
        )

    report = combined(one("a.json", 1), one("b.json", 2), one("c.json", 3))
    assert report.calibration is not None
    assert report.dof == 2 * 8
    assert report.calibration.intrinsics.fx == pytest.approx(report.calibration.intrinsics.fy, abs=1e-9)
    held = combined(one("a.json", 1), one("b.json", 2, fy_more=1.0))
    assert {finding.rule for finding in held.findings} == {"other-lens-model"}
    assert {finding.rule for finding in combined(one("a.json", 1), made("b.json", 2)).findings} == {
        "other-lens-model"
    }


def test_chi2_is_what_a_straightforward_sum_gives() -> None:
    sources = flights(3)
    found = weighted_mean(
        [one.calibration for one in sources], [C for one in sources if (C := one.covariance)]
    )
    X = np.array(
        [Solvable.BROWN.values(one.calibration.intrinsics, one.calibration.distortion) for one in sources]
    )
    off = X - X.mean(axis=0)
    W = np.linalg.inv(spread())
    assert found.chi2 == pytest.approx(float(np.einsum("ni,ij,nj->", off, W, off)), rel=1e-4)


def test_the_test_refuses_as_often_as_it_says() -> None:
    """Of calibrations of one camera 1 in 1000 combinations is refused; p is uniform."""
    p = []
    for trial in range(60):
        sources = [made(f"{at}.json", 1000 + 3 * trial + at) for at in range(3)]
        p.append(
            weighted_mean(
                [one.calibration for one in sources], [C for one in sources if (C := one.covariance)]
            ).p
        )
    assert min(p) > 0.001
    assert 0.35 < float(np.mean(p)) < 0.65
    assert 0.02 < float(np.mean(np.array(p) < 0.2)) < 0.4
