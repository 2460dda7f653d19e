"""Write the files of schemas/ from the records they are of; ``make schemas`` runs this, a test keeps them fresh."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from calibrary.records import Record
from calibrary.records.schema import SCHEMA_BASE, parts, schema

FOLDER: Final = Path(__file__).parents[1] / "schemas"

PRINTED: Final[Mapping[str, str]] = {
    "calibration-1": "calibrary.calibration:Calibration",
    "finding-1": "calibrary.validation:Finding",
    "report-1": "calibrary.jobs.extract.report:ExtractReport",
    "diff-1": "calibrary.jobs.diff.comparison:DiffReport",
    "fleet-diff-1": "calibrary.jobs.diff.fleet:FleetDiffReport",
    "check-1": "calibrary.jobs.check.run:CheckReport",
    "corners-1": "calibrary.calib.corners_file:CornersFile",
    "calibration-result-3": "calibrary.jobs.calibrate.report:CalibrateReport",
    "rig-calibration-result-2": "calibrary.jobs.calibrate.rig_report:RigReport",
    "rig-corners-1": "calibrary.jobs.calibrate.rig:RigCorners",
    "calibrate-watch-1": "calibrary.jobs.calibrate_watch.session:WatchStatus",
    "registry-audit-1": "calibrary.jobs.audit.report:AuditReport",
    "registry-status-1": "calibrary.jobs.status.run:RegistryStatus",
    "registry-check-1": "calibrary.registry.checks:CheckDocument",
    "registry-export-1": "calibrary.jobs.export.run:ExportReport",
    "undistort-1": "calibrary.jobs.undistort.run:UndistortReport",
    "inspect-1": "calibrary.jobs.inspect.run:InspectReport",
    "inspect-files-1": "calibrary.jobs.inspect.run:InspectFilesReport",
    "k-1": "calibrary.jobs.k.run:OneK",
    "convert-2": "calibrary.jobs.convert.run:ConvertReport",
    "formats-1": "calibrary.parsers.discovery:FormatListing",
    "onboard-1": "calibrary.jobs.onboard.report:OnboardReport",
    "entry-listing-1": "calibrary.registry.snapshot:ListedEntries",
    "registry-show-1": "calibrary.registry.history:ShownEntry",
    "registry-log-1": "calibrary.registry.history:LogReport",
    "registry-change-1": "calibrary.registry.proposals:ChangeReport",
    "registry-sync-1": "calibrary.registry.sync:SyncReport",
    "registry-begun-1": "calibrary.registry.init:InitReport",
    "catalogue-listing-1": "calibrary.catalogue:CatalogueListing",
    "resolution-1": "calibrary.jobs.resolve.run:FleetAnswer",
    "published-3": "calibrary.registry.published.manifest:SignedManifest",
    "published-list-1": "calibrary.registry.published.manifest:PublishedList",
    "published-camera-3": "calibrary.registry.published.manifest:PublishedCamera",
    "registry-publish-1": "calibrary.registry.published.write:Publication",
}
"""The documents that calibrary writes for programs: every field is always there. A record in several of them has its
schema in the first, and the others refer to it there."""

WRITTEN_BY_PEOPLE: Final[Mapping[str, str]] = {
    "policy-1": "calibrary.policy:Policy",
    "registry-1": "calibrary.registry.configuration:Configuration",
    "entry-1": "calibrary.registry.entry:Entry",
    "lock-1": "calibrary.registry.locking:Lock",
    "catalogue-1": "calibrary.catalogue:Maker",
}
"""The documents that people write too: a field with a default may be left out."""


def schemas() -> dict[str, dict[str, Any]]:
    """Every generated schema by its name."""
    made: dict[str, dict[str, Any]] = {}
    homes: dict[type, str] = {}
    for name, path in PRINTED.items():
        kind = _record(path)
        made[name] = schema(kind, name, printed=True, homes=homes)
        defined = made[name].get("$defs", {})
        homes |= {
            part: f"{SCHEMA_BASE}{name}#/$defs/{key}" for key, part in parts(kind).items() if key in defined
        }
        homes[kind] = f"{SCHEMA_BASE}{name}"
    made |= {name: schema(_record(path), name) for name, path in WRITTEN_BY_PEOPLE.items()}
    return made


def text_of(document: Mapping[str, Any]) -> str:
    """A schema as the text of its file."""
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _record(path: str) -> type[Record]:
    module, _, name = path.partition(":")
    kind: type[Record] = getattr(import_module(module), name)
    return kind


if __name__ == "__main__":
    for name, document in schemas().items():
        (FOLDER / f"{name}.schema.json").write_text(text_of(document), encoding="utf-8")
