"""Tables that can be written as CSV or Parquet: cameras and images of a run, registry entries, files, known cameras.

The columns of a calibration are the same in all tables: first the fixed ones, then the coefficients of the
distortion models that occur. The origin of cx_px and cy_px is the outer corner of the top-left pixel.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.errors import InputError
from calibrary.extras import TABLES, require
from calibrary.interop.notebook import MOST_ROWS, html_rows
from calibrary.jobs.audit.report import AuditReport
from calibrary.jobs.extract.report import CameraDocument, ExtractReport
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.inspect.run import InspectedFile
from calibrary.known_camera import KnownCamera
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.quality import Quality
from calibrary.registry.fields import Row
from calibrary.registry.snapshot import StoredEntry
from calibrary.registry.spreadsheet import csv_text

if TYPE_CHECKING:
    import pyarrow as pa

Cell: TypeAlias = str | int | float | bool | None

COUNTS: Final = frozenset({"width_px", "height_px", "images"})
MEASURES: Final = re.compile(r".*_(?:px|mm|um|share)|fx_over_width")


class Table(Struct, frozen=True, dict=True):
    """A table of rows by column name; its columns are those of all rows, in order of first occurrence.

    Attributes:
        rows: the rows; a missing column name is an empty cell.
    """

    rows: Sequence[Mapping[str, Cell]]

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The column names."""
        return tuple(dict.fromkeys(name for row in self.rows for name in row))

    def to_dict(self) -> dict[str, list[Cell]]:
        """The columns by name, as accepted by ``pandas.DataFrame`` and ``polars.DataFrame``."""
        return {name: [row.get(name) for row in self.rows] for name in self.columns}

    def to_csv(self) -> str:
        """The table as CSV text with commas, decimal points and all digits; no cell is a formula in a spreadsheet."""
        return csv_text(self.columns, ([row.get(name) for name in self.columns] for row in self.rows))

    def to_parquet(self) -> bytes:
        """The table as a Parquet file.

        Raises:
            MissingExtraError: pyarrow is not installed.
        """
        require(TABLES, "a Parquet table")
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = self.to_dict()
        arrays = {name: pa.array(values, _type_of(name, values)) for name, values in columns.items()}
        origin = {"pixel_origin": "outer corner of the top-left pixel"}
        file = io.BytesIO()
        pq.write_table(pa.table(arrays).replace_schema_metadata(origin), file)
        return file.getvalue()

    def write(self, path: Path) -> None:
        """Write the table in the format of the file's suffix; an existing file is replaced atomically.

        Raises:
            InputError: the suffix is neither .csv nor .parquet, or the file cannot be written.
            MissingExtraError: pyarrow is not installed, for .parquet.
        """
        check_table_place(path)
        data = self.to_parquet() if path.suffix.lower() == ".parquet" else self.to_csv().encode()
        write_files({path: data})

    def _repr_html_(self) -> str:
        """HTML of the first rows, for notebooks."""
        shown = [[_cell_text(row.get(name)) for name in self.columns] for row in self.rows[:MOST_ROWS]]
        return html_rows(self.columns, shown, many=len(self.rows))


def check_table_place(path: Path) -> None:
    """Check before any work is done that a table can be written.

    Raises:
        InputError: the suffix is neither .csv nor .parquet, or the folder is not writable.
        MissingExtraError: pyarrow is not installed, for .parquet.
    """
    if path.suffix.lower() not in {".csv", ".parquet"}:
        raise InputError(
            "expected a name that ends in .csv or .parquet, or - for CSV on standard output", source=str(path)
        )
    if path.suffix.lower() == ".parquet":
        require(TABLES, "a Parquet table")
    check_folder(path)


def _type_of(name: str, values: Iterable[Cell]) -> pa.DataType:
    """Type of a column; if the name has a unit, the type is the same in every table."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if name in COUNTS:
        return pa.int64()
    if MEASURES.fullmatch(name):
        return pa.float64()
    simple = {frozenset({bool}): pa.bool_(), frozenset({int}): pa.int64()}
    return simple.get(frozenset(kinds)) or (pa.float64() if kinds and kinds <= {int, float} else pa.string())


def _cell_text(value: Cell) -> str:
    return "" if value is None else f"{value:.7g}" if isinstance(value, float) else str(value)


K: Final = ("fx", "fy", "cx", "cy", "skew")
PX: Final = frozenset(f"intrinsics.{name}" for name in K) | {"quality.rms_px"}


def camera_table(report: ExtractReport) -> Table:
    """Table of the cameras of a run, with their K if they have one."""
    return Table(
        [_in_run(one) | {"images": len(one.images) + one.more_images} | _of(one) for one in report.cameras]
    )


def image_table(report: ExtractReport) -> Table:
    """Table of the images of a run with their camera and its K; images that were not read come last."""
    rows: list[dict[str, Cell]] = []
    for camera in report.cameras:
        calibration = _of(camera)
        for state in camera.states:
            said = _in_run(camera) | {"verdict": state.verdict.value, "why": state.why}
            rows += ({"image": image} | said | calibration for image in state.images)
    rows += _not_read("unreadable", report.rejected)
    rows += _not_read("skipped", report.skipped)
    return Table(rows)


def _not_read(verdict: str, files: Iterable[SkippedFile]) -> Iterator[dict[str, Cell]]:
    return ({"image": one.name, "verdict": verdict, "why": one.reason} for one in files)


def _in_run(camera: CameraDocument) -> dict[str, Cell]:
    return {
        "camera": camera.id,
        "label": camera.label,
        "verdict": camera.verdict.value,
        "why": camera.why,
    }


def _of(camera: CameraDocument) -> dict[str, Cell]:
    return _calibration(camera.calibration) if camera.calibration is not None else _key(camera.camera)


def entry_table(entries: Sequence[StoredEntry], rows: Sequence[Row], fields: Sequence[str] | None) -> Table:
    """Table of the entries of a registry.

    Args:
        entries: the stored entries.
        rows: their fields, in the same order.
        fields: names of the only fields to show; None for all fields of a table of cameras.
    """
    if fields is not None:
        return Table([{_with_unit(field): _cell(row.get(field)) for field in fields} for row in rows])
    return Table([_entry(stored) for stored in entries])


def _entry(stored: StoredEntry) -> dict[str, Cell]:
    entry, validity = stored.entry, stored.entry.validity
    first, last = (validity.first, validity.last) if validity is not None else (None, None)
    return {
        "entry": stored.id,
        "label": entry.label,
        "status": "proposed" if stored.is_pending else entry.status.value,
        "valid_from": first.isoformat() if first is not None else None,
        "valid_until": last.isoformat() if last is not None else None,
        "tags": " ".join(entry.tags) or None,
    } | _calibration(entry.calibration)


def _with_unit(field: str) -> str:
    name = field.rpartition(".")[2]
    in_px = field in PX or (field.startswith("quality.std.") and name in K)
    return f"{name}_px" if in_px and not name.endswith("_px") else name


def _cell(value: object) -> Cell:
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return value if value is None or isinstance(value, str | int | float) else str(value)


def file_table(files: Sequence[InspectedFile]) -> Table:
    """Table of the calibrations in files, and of the files that were not read."""
    rows: list[dict[str, Cell]] = []
    for one in files:
        about: dict[str, Cell] = {"file": str(one.path), "format": one.format, "error": one.error}
        found = [*map(_calibration, one.calibrations), *map(_calibration, one.unsized)]
        rows += (about | item for item in found or [{}])
    return Table(rows)


def audit_table(report: AuditReport) -> Table:
    """Table of the units and firmware versions that flew, with the registry's entry for each."""
    labels = {unit.serial: unit.label for unit in report.units if unit.serial is not None}
    rows = []
    for one in report.cameras:
        flown = next((source for source in one.sources if source.chosen), None)
        rows.append(
            {
                "label": labels.get(one.camera.serial or ""),
                "use": one.use.value,
                "entry": one.entry,
                "why": one.why,
                "images": one.images,
                "first": one.first.isoformat() if one.first is not None else None,
                "last": one.last.isoformat() if one.last is not None else None,
                "entry_fx_px": one.fx,
                "images_fx_px": flown.fx if flown is not None else None,
                "difference_share": flown.difference if flown is not None else None,
            }
            | _key(one.camera)
        )
    return Table(rows)


def catalogue_table(cameras: Sequence[KnownCamera]) -> Table:
    """Table of the known cameras; several spellings of a Model are in one cell."""
    return Table(
        [
            {
                "make": one.make,
                "model": "; ".join(one.models),
                "name": one.title,
                "sub_camera": one.sub_camera,
                "lens": one.lens,
                **_size(one.native_size),
                "pitch_um": one.pitch_um,
                "sensor_width_mm": one.sensor_width_mm,
                "focal_mm": one.focal_mm,
                "focal_35mm_mm": one.focal_35mm,
                "projection": one.projection.value,
                "fx_over_width": one.fx_over_w,
                "spread_share": one.spread,
            }
            for one in cameras
        ]
    )


def _calibration(made: Calibration | UnsizedCalibration) -> dict[str, Cell]:
    lens, quality, source = made.distortion, made.quality or Quality(), made.provenance
    # The standard deviations that pages and notebooks show as ±.
    inflation = math.sqrt(quality.inflation)
    spread = {name: value * inflation for name, value in quality.std.items()}
    return (
        _key(made.camera)
        | _size(made.intrinsics.image_size)
        | {f"{name}_px": getattr(made.intrinsics, name) for name in K}
        | {f"sigma_{name}_px": spread.get(name) for name in K[:4]}
        | {
            "distortion": lens.model if lens is not None else "unknown",
            "grade": made.grade.value,
            "rms_px": quality.rms_px,
            "date": source.date,
            "tool": source.tool,
            "source": source.source,
            "tag": source.tag,
        }
        | (lens.shown if lens is not None else {})
    )


def _key(camera: CameraKey) -> dict[str, Cell]:
    return {
        "make": camera.make,
        "model": camera.model,
        "sub_camera": camera.sub_camera,
        "lens": camera.lens,
        "focal_mm": camera.focal_mm,
        "capture_mode": camera.capture_mode,
        **_size(camera.image_size),
        "serial_hash": camera.serial,
        "firmware": camera.firmware,
    }


def _size(size: ImageSize | None) -> dict[str, Cell]:
    width, height = size if size is not None else (None, None)
    return {"width_px": width, "height_px": height}
