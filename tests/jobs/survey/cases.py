"""Labelled cases, as data in ``table.yaml``: images of a camera, a file beside them, and a registry.

Each command's answer on the K of the file and on that of the entry is "for", "against", or None if it says neither.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from calibrary import CameraKey
from calibrary.arguments import Reading, Stated, Terms
from calibrary.errors import CalibraryError
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.report import AuditReport, Use
from calibrary.jobs.check.run import check_files
from calibrary.jobs.diff import compare
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.jobs.extract.calibration_files import Rightness
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.run import run
from calibrary.jobs.fleet import Fleet, create_registry
from calibrary.jobs.onboard.estimates import Serves
from calibrary.jobs.onboard.report import Agreement, Decision, Estimate, Kind
from calibrary.jobs.onboard.run import Onboarding
from calibrary.jobs.resolve import resolve
from calibrary.records import replace
from calibrary.registry.paths import id_of
from calibrary.registry.registry import Registry
from calibrary.validation import Severity, Verdict
from tests.jobs.extract.fleet import DEWARP, picture
from tests.registry.entries import put_entries
from tests.thorough import examples

TABLE: Final[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("table.yaml").read_text("utf-8"))
FOR, AGAINST = "for", "against"
BY_ENTRY: Final = {"against-last-approved", "against-relatives", "material-change"}
Answer = str | None


class Family(NamedTuple):
    """Images of one camera.

    Attributes:
        name: of the family.
        fx: the focal length that is right, px.
        size: of the images.
        tags: of each image.
        own: whether the images state a calibration of their unit.
        key: what a person states of the camera who adds a file of it.
    """

    name: str
    fx: float
    size: tuple[int, int]
    tags: dict[str, Any]
    own: bool
    key: dict[str, Any]

    def images(self, folder: Path) -> Path:
        """Two images."""
        tags = {name: _tag(value) for name, value in self.tags.items()}
        if self.tags:
            tags["date_time"] = "2026:05:04 10:00:00"
        if self.own:
            tags["dewarp"] = DEWARP.replace("3660.5,3655.25", f"{self.fx},{self.fx - 5.25}", 1)
        for number in (1, 2):
            picture(folder / f"IMG_{number}.jpg", self.size, **tags)
        return folder

    def registry(self, folder: Path, factor: float) -> Path:
        """A registry in git with an entry whose focal length is off by a factor, approved by no check."""
        file = self.file(folder.with_suffix(".xml"), {"scale": factor})
        create_registry(folder)
        terms = Terms(approve=True, reason="measured", force=True)
        [proposed] = Fleet(folder).propose(file, camera=CameraKey(**self.key), terms=terms).proposals.items
        put_entries(Registry.open(folder), [(replace(proposed.after, override=None), None)], "Measure\n")
        return folder

    def file(self, path: Path, how: Mapping[str, Any]) -> Path:
        """A calibration file that is off as ``how`` says."""
        (width, height), focal = self.size, self.fx * how.get("scale", 1.0)
        if "key" in how:
            path = path.with_name("cameras.json")
            key = f"{how['key']} {width} {height} perspective {focal / width:.4f}"
            camera = {"projection_type": "perspective", "width": width, "height": height}
            model = {"focal": focal / width, "k1": -0.1, "k2": 0.02}
            path.write_text(json.dumps({key: camera | model}))
            return path
        # Another measurement has no number in common; one of the same factor is a copy.
        percent = 100.0 * (how.get("scale", 1.0) - 1.0)
        # Metashape's f is fy, and b1 is fx − fy; p1 and p2 stand in its own order.
        lens = {"k1": -0.1}
        if self.own:
            lens = {"b1": 5.25, "k1": -0.268, "k2": 0.112, "k3": -0.034, "p1": -0.0001, "p2": 0.0008}
        own = "".join(f"<{name}>{value * (1 + percent / 1000)}</{name}>" for name, value in lens.items())
        cx, cy = -4.5 + 0.3 * percent + how.get("shift", 0.0) * width, 22.75 - 0.2 * percent
        path.write_text(
            f"<calibration><projection>frame</projection><width>{width}</width><height>{height}</height>"
            f"<f>{focal - 5.25 if self.own else focal}</f><cx>{cx}</cx><cy>{cy}</cy>{own}"
            "<date>2026-04-01T10:00:00Z</date></calibration>"
        )
        return path


def _tag(value: Any) -> Any:
    return tuple(map(_tag, value)) if isinstance(value, list) else value


class Case(NamedTuple):
    """Images, a file beside them or none, a registry or none, and the expected answers on the file and the entry."""

    family: Family
    registry: str
    file: str | None
    expected: str | None
    of_entry: str | None

    @property
    def name(self) -> str:
        """Of the test."""
        return f"{self.family.name}-{self.registry}-{self.file or 'alone'}"


def cases(section: str = "families") -> Iterator[Case]:
    """All of a section of the table in a thorough run; else a ninth of what is wrong and a quarter of the others."""
    for at, (name, told) in enumerate(TABLE[section].items()):
        size = (told["size"][0], told["size"][1])
        family = Family(name, told["fx"], size, told["tags"], told.get("own", False), told.get("key", {}))
        for state, (registry, line) in enumerate(told["cases"].items(), start=at):
            labels, _, of_entry = (part.strip() for part in line.partition("|"))
            for turn, (file, label) in enumerate(
                zip(TABLE["files"], labels.split(), strict=True), start=state
            ):
                if turn % examples(9 if label == "X" else 4, 1) == 0:
                    yield Case(family, registry, file, label, of_entry or None)
            if of_entry and state % examples(2, 1) == 0:
                yield Case(family, registry, None, None, of_entry)


class Answers(NamedTuple):
    """What the commands say of the K of the file and of the entry."""

    of_file: dict[str, Answer]
    of_entry: dict[str, Answer]
    said: list[str]


class Folder(NamedTuple):
    """A case on disk.

    Attributes:
        case: it.
        images: folder with the images and the file.
        file: the file; None if there is none.
        registry: None if there is none.
        empty: a registry without entries, for commands that need one.
        entry: id of the registry's entry.
    """

    case: Case
    images: Path
    file: Path | None
    registry: Path | None
    empty: Path

    @classmethod
    def laid_out(cls, case: Case, folder: Path, images: Path, registry: Path | None, empty: Path) -> Folder:
        """Link the images of the family into a folder, and write the file beside them."""
        folder.mkdir()
        for one in images.iterdir():
            os.link(one, folder / one.name)
        file = case.family.file(folder / "camera.xml", TABLE["files"][case.file]) if case.file else None
        return cls(case, folder, file, registry, empty)

    @property
    def entry(self) -> str | None:
        """Id of the registry's entry."""
        if self.registry is None:
            return None
        [path] = Registry.open(self.registry).snapshot().paths
        return id_of(path)

    def answers(self) -> Answers:
        """Ask every command."""
        found = Answers({}, {}, [])
        report = run(self.images, registry=self.registry or (), workers=1)
        _extract(self, report, found)
        if self.file is not None:
            _check(self, report, found)
            _diff(self, found)
            if self.case.family.key:
                _add(self, found)
        if self.registry is not None:
            _audit(self, Fleet(self.registry).audit(self.images, workers=1), found)
            _resolve(self, found)
        _onboard(self, found)
        return found


def _extract(one: Folder, report: ExtractReport, found: Answers) -> None:
    [camera] = report.judged
    valid, K = camera.verdict is Verdict.VALID, camera.calibration
    steps = camera.fallback.steps if camera.fallback is not None else ()
    why = [camera.reason or "", *report.warnings, *(step.why for step in steps)]
    found.said.append(f"extract: {camera.verdict} fx {K.intrinsics.fx if K else None}: {why}")
    if one.file is not None:
        used = valid and K is not None and K.provenance.source == one.file.name
        told = any(one.file.name in text and ("off" in text or "is not used" in text) for text in why)
        refused = any(step.is_refused and step.source == one.file.name for step in steps)
        found.of_file["extract"] = FOR if used else AGAINST if told or refused else None
    if one.registry is not None:
        named = any((one.entry or "?") in text and "beside the images" not in text for text in why[:1])
        of_entry = K is not None and (one.entry or "?") in (K.provenance.source or "")
        found.of_entry["extract"] = FOR if valid and of_entry else AGAINST if not valid and named else None


def _check(one: Folder, report: ExtractReport, found: Answers) -> None:
    assert one.file is not None
    [checked] = check_files([one.file], report, Reading(), 100.0, needed=True).files
    found.said.append(f"check: {checked.verdict}: {checked.message}")
    found.of_file["check"] = {Rightness.RIGHT: FOR, Rightness.OFF: AGAINST}.get(checked.verdict)


def _diff(one: Folder, found: Answers) -> None:
    """The file against the images; these give a K only where it needs no second source."""
    assert one.file is not None
    try:
        told = compare(one.images / "IMG_1.jpg", one.file)
    except CalibraryError as error:
        found.said.append(f"diff: {error}")
        found.of_file["diff"] = None
        return
    found.said.append(f"diff: {told.verdict} {told.alarm}: {told.reasons}")
    alike = {ChangeVerdict.IDENTICAL, ChangeVerdict.NOISE, ChangeVerdict.NEGLIGIBLE}
    # Of the entry it is not told: that the images agree with the file does not say that K has not moved.
    same = told.verdict in alike and one.case.of_entry != "X"
    found.of_file["diff"] = AGAINST if told.alarm else FOR if same else None


def _add(one: Folder, found: Answers) -> None:
    assert one.file is not None
    key = dict(one.case.family.key)
    try:
        change = Fleet(one.registry or one.empty).propose(one.file, camera=CameraKey(**key))
    except CalibraryError as error:
        found.said.append(f"add: {error}")
        found.of_file["add"] = AGAINST
        return
    told = [finding for finding in change.proposals.findings if finding.severity is not Severity.NOTE]
    warned = [text for item in change.proposals.items for text in item.warnings]
    found.said.append(f"add: {[f'{finding.rule}: {finding.message}' for finding in told]} {warned}")
    # It sees no image: of an entry that is wrong it can only say how the two differ.
    knows_entry = one.case.of_entry == "R"
    rules = {finding.rule for finding in told} - (set() if knows_entry else BY_ENTRY)
    named = any("names another camera" in text for text in warned)
    found.of_file["add"] = AGAINST if rules or named else FOR if knows_entry else None


def _audit(one: Folder, report: AuditReport, found: Answers) -> None:
    rules = {Rule(finding.rule) for finding in report.findings if finding.severity is not Severity.NOTE}
    told = [f"{finding.severity} {finding.rule}: {finding.message}" for finding in report.findings]
    found.said.append(f"audit: {told}; {report.not_compared}")
    if report.cameras[0].use is not Use.USED:
        return
    against = rules & {Rule.DRIFT, Rule.TAGS, Rule.PIXELS}
    silent = any(what.what != (one.file.name if one.file else "") for what in report.not_compared)
    found.of_entry["audit"] = AGAINST if against else None if silent else FOR
    if one.file is not None:
        unread = any(what.what == one.file.name for what in report.not_compared)
        # Where the entry is in doubt, a file that it says nothing of may be right or not.
        fine = None if unread or against else FOR
        found.of_file["audit"] = AGAINST if Rule.FILE in rules else fine


def _resolve(one: Folder, found: Answers) -> None:
    told = resolve(one.images / "IMG_1.jpg", registry=one.registry)
    found.said.append(f"resolve: {told.why}; {told.use}: {told.use_reason}; {told.disagreements}")
    found.of_entry["resolve"] = None
    if told.entry is not None:
        found.of_entry["resolve"] = AGAINST if told.calibration is None else FOR


def _onboard(one: Folder, found: Answers) -> None:
    if not one.case.family.key:
        return
    done = Onboarding(
        folder=one.images,
        registry=Registry.open(one.registry or one.empty),
        camera=CameraKey(),
        stated=Stated(),
        board=None,
        square_mm=None,
        serves=Serves.MODEL,
        ask=None,
        trusted=None,
        flight=False,
        label=None,
        workers=1,
        progress=None,
    ).run(None)
    [camera] = done.cameras
    kinds = [f"{e.kind}: {e.name} fx {e.intrinsics.fx:.0f} {e.standing}" for e in camera.estimates]
    found.said.append(f"onboard: {camera.decision}: {camera.reason}; {kinds}")
    good = camera.decision is not Decision.REFUSED
    for kind, into in ((Kind.FILE, found.of_file), (Kind.REGISTRY, found.of_entry)):
        if (kind is Kind.FILE and one.file is None) or (kind is Kind.REGISTRY and one.registry is None):
            continue
        stated = [e for e in camera.estimates if e.kind is kind]
        into["onboard"] = (
            _of_estimate(stated[0], camera.estimates, good=good)
            if stated
            else AGAINST
            if kind is Kind.FILE
            else None
        )


def _of_estimate(estimate: Estimate, all_: Sequence[Estimate], *, good: bool) -> Answer:
    """A proposal that differs from another measurement is told to; between the entry and a new one it is open."""
    differs = any(one.agreement is Agreement.DIFFERS for one in all_)
    if estimate.chosen:
        return FOR if good and not differs else AGAINST
    if estimate.kind is Kind.REGISTRY and estimate.agreement is Agreement.DIFFERS:
        return None
    if estimate.overruled or (good and estimate.agreement in {Agreement.DIFFERS, Agreement.DISAGREES}):
        return AGAINST
    return FOR if good and estimate.agrees and not differs else None
