"""Discovery of the formats: the modules in ``formats/``, the table of refused ones, other packages; and their list.

Formats are imported only when needed, so that ``import calibrary.parsers`` stays fast.
"""

from __future__ import annotations

import inspect
import re
import sys
import warnings
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Annotated, Final, TypeAlias

from calibrary.errors import InputError
from calibrary.parsers import formats as folder
from calibrary.parsers.content import Syntax
from calibrary.parsers.format import Format
from calibrary.parsers.refused import REFUSED
from calibrary.records import Meta, Record

GROUP = "calibrary.formats"
"""The entry-point group by which other packages add formats."""

BY_HAND: Final = "hand_made"
"""The format that is asked last, of files that no other one claims."""

FAMILIES: Final[Mapping[str, tuple[str, ...]]] = {
    "colmap": ("colmap_binary", "colmap_text"),
    "matlab": ("matlab_json", "matlab_mat"),
    "metashape": ("metashape_archive", "metashape_document"),
    "numpy_arrays": ("k_npy", "numpy_npz"),
    "opf": ("opf_calibrated_cameras", "opf_input_cameras", "opf_project"),
    "photomodeler": ("photomodeler_export", "photomodeler_report"),
    "realitycapture": ("realitycapture_csv", "realitycapture_xmp"),
    "ros": ("ros_camera_info", "ros_ini"),
}
"""Modules with the formats of one program; any other has the format of its name."""

ONLY: Final[Mapping[tuple[Syntax, ...], str]] = {
    (Syntax.XML,): "adobe_lcp agisoft_xml blocksexchange_xml contextcapture_opt gazebo_sdf micmac_xml",
    (
        Syntax.JSON,
    ): "alicevision_sfm gyroflow odm_cameras opensfm opf stac_interior_orientation transforms_json",
    (Syntax.TEXT,): (
        "asp_tsai australis_report bouguet_m bundler esri_cameras hugin_pto inpho_prj kapture keyed_text nvm "
        "photomodeler pix4d_cam pix4d_camera_parameters ros usgs_report"
    ),
    (Syntax.BINARY,): "colmap_database numpy_arrays",
    (Syntax.XML, Syntax.BINARY): "metashape",
    (Syntax.XML, Syntax.TEXT): "lensfun_xml realitycapture",
    (Syntax.XML, Syntax.TEXT, Syntax.JSON): "opencv_storage",
    (Syntax.TEXT, Syntax.BINARY): "colmap",
    (Syntax.TEXT, Syntax.JSON): "mrcal",
    (Syntax.TEXT, Syntax.JSON, Syntax.BINARY): "matlab",
}
"""Built-in modules by the syntaxes of their files, not loaded for files of another; others are always loaded."""

PROGRAMS: Final[Mapping[str, tuple[str, ...]]] = {
    "arcgis": ("esri_cameras",),
    "colmap": ("colmap_text", "colmap_binary", "colmap_database"),
    "contextcapture": ("blocksexchange_xml",),
    "metashape": ("agisoft_xml",),
    "micmac": ("micmac_xml",),
    "nerfstudio": ("transforms_json",),
    "numpy": ("numpy_npz", "k_npy"),
    "odm": ("odm_cameras",),
    "opencv": ("opencv_storage", "numpy_npz"),
    "pix4d": ("pix4d_cam", "opf_calibrated_cameras"),
    "realityscan": ("realitycapture_csv",),
    "ros": ("ros_camera_info", "ros_ini"),
    "stac": ("stac_interior_orientation",),
}
"""Formats by the name of the program that reads them. A program's name is accepted wherever a format's is.

To add a program, add its line: the formats that it reads and that are written here, the usual one first; a file with
the suffix of another one gets that one. A program with the name of its format (kalibr, mrcal, opensfm) needs none.
Completion, ``calibrary formats`` and all commands follow, and ``tests/parsers/test_programs.py`` tests the line.
"""

Suffix: TypeAlias = Annotated[str, Meta(pattern=r"^\.")]
Values: TypeAlias = Annotated[tuple[str, ...], Meta(min_length=1)]


def format_named(name: str, file: str | Path = "") -> Format:
    """The format with this name, or that of the program with this name.

    Args:
        name: of a format, or of one of :data:`PROGRAMS`.
        file: name of the file to read or write, whose suffix chooses among the formats of a program.

    Raises:
        InputError: no format or program has this name; the message states the most similar ones.
    """
    if name in PROGRAMS:
        records = [_built_in(one) for one in PROGRAMS[name]]
        suffix = Path(file).suffix.lower()
        return next((record for record in records if suffix in record.suffixes), records[0])
    if name in _modules():
        return _built_in(name)
    if name in known_formats():
        return known_formats()[name]
    similar = " or ".join(_similar(name))
    meant = f"did you mean {similar}? " if similar else ""
    raise InputError(f"there is no format {name!r}; {meant}'calibrary formats' lists them all")


def _similar(name: str) -> list[str]:
    """Up to three names of formats and programs that contain the name or a part of it, or are spelled like it."""
    from difflib import get_close_matches  # noqa: PLC0415  only for a name that is wrong

    word, every = name.casefold(), [*PROGRAMS, *known_formats()]
    alike = [one for one in every if len(word) > 2 and (word in one or one in word)]
    return list(dict.fromkeys([*alike, *get_close_matches(word, every)]))[:3]


@cache
def known_formats() -> Mapping[str, Format]:
    """All formats by name, in alphabetical order.

    A registered format that cannot be loaded, or has the name of another format, is omitted with a warning,
    so that other files can still be read.
    """
    found = {name: _built_in(name) for name in _modules()} | _rows() | _not_built_in()
    return MappingProxyType(dict(sorted(found.items())))


@cache
def _not_built_in() -> dict[str, Format]:
    """The refused formats, and the formats of other packages."""
    from importlib.metadata import entry_points  # noqa: PLC0415  it loads zipfile and email

    found = {record.name: record for record in REFUSED}
    for point in entry_points(group=GROUP):
        try:
            record = point.load()
        except Exception as error:  # noqa: BLE001  foreign code may fail in any way at import
            _complain(f"{point.value} cannot be loaded: {error}")
            continue
        if not isinstance(record, Format):
            _complain(f"{point.value} is not a calibrary.parsers.format.Format")
        elif record.name in found or record.name in _modules() or record.name in _rows():
            _complain(f"{point.value} calls itself {record.name!r}, which is taken")
        else:
            found[record.name] = record
    return found


@cache
def formats_of(syntax: Syntax) -> tuple[Format, ...]:
    """The formats that a file of this syntax may have; other built-in formats are not loaded."""
    elsewhere = {name for others, names in ONLY.items() if syntax not in others for name in names.split()}
    here = (name for name, module in _modules().items() if module not in elsewhere and name != BY_HAND)
    found = {name: _built_in(name) for name in here} | _rows() | _not_built_in()
    return tuple(record for _, record in sorted(found.items()) if syntax in record.syntaxes)


@cache
def _modules() -> Mapping[str, str]:
    """The module of each format that has one; modules that start with an underscore are helpers."""
    found = (module.name for module in iter_modules(folder.__path__) if not module.name.startswith("_"))
    return {name: module for module in found for name in FAMILIES.get(module, (module,))}


@cache
def _rows() -> dict[str, Format]:
    """The formats of the tables of programs, by name."""
    files = import_module(f"{folder.__name__}._table").FILES
    rows = (row for name in files for row in import_module(f"{folder.__name__}.{name}").ROWS)
    return {row.name: row.format() for row in rows}


@cache
def _built_in(name: str) -> Format:
    module = import_module(f"{folder.__name__}.{_modules()[name]}")
    records: tuple[Format, ...] = getattr(module, "FORMATS", None) or (module.FORMAT,)
    found = next((record for record in records if record.name == name), None)
    if found is None:
        raise InputError(f"{module.__name__} must hold FORMAT or FORMATS, with a Format of the name {name}")
    return found


def _complain(what: str) -> None:
    warnings.warn(f"entry point of {GROUP}: {what}; it is left out", RuntimeWarning, stacklevel=4)


class ListedFormat(Record):
    """One calibration file format.

    Attributes:
        name: name for --format and --to.
        title: common name.
        programs: names of programs that stand for it; for one that reads several formats, the suffix chooses.
        suffixes: usual suffixes; a file is recognised by its content.
        reads, writes: whether its files can be read and written.
        updates: whether cameras are written into an existing file.
        refuses: why files of the format are never read, and what to do instead.
        needs_image_size: whether files do not state the image size.
        convention: conventions of its numbers, in sentences.
        states: what a file can state of its origin: date, tool, operator, focus.
        options: options for --set, with their values.
        questions: what each option answers.
        reference: address of its description.
    """

    name: str
    title: str
    programs: tuple[str, ...]
    suffixes: tuple[Suffix, ...]
    reads: bool
    writes: bool
    updates: bool
    refuses: str | None
    needs_image_size: bool
    convention: tuple[str, ...] | None
    states: tuple[str, ...]
    options: Mapping[str, Values]
    questions: Mapping[str, str]
    reference: str

    @property
    def access(self) -> str:
        """Whether its files can be read, written or both, in words."""
        if self.refuses is not None:
            return "refused"
        if self.updates:
            return "read, update"
        return "read, write" if self.writes else "read"

    @property
    def facts(self) -> tuple[str, ...]:
        """What there is to know of its files, in sentences: conventions, image size, origin, options."""
        size = (
            ("the file does not state the image size: `--image-size WxH`",) if self.needs_image_size else ()
        )
        origin = (f"a file can state its {', '.join(self.states)}",) if self.states else ()
        options = (
            f"`--set {name}={'|'.join(values)}`: {self.questions[name]}"
            for name, values in self.options.items()
        )
        return (*(self.convention or ()), *size, *origin, *options)

    @property
    def words(self) -> str:
        """What its module says of it, for a terminal: an example in the format's own words, and the source."""
        record = format_named(self.name)
        module = sys.modules.get(getattr(record.sniff, "__module__", ""))
        said = inspect.cleandoc(record.words or getattr(module, "__doc__", None) or "")
        plain = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"\1", said)
        return re.sub(r"(?m)::$", ":", plain.replace("``", ""))


class FormatListing(Record, tag_field="schema", tag="calibrary/formats-1"):
    """Output of ``calibrary formats --json``: the calibration file formats that can be read or written.

    Attributes:
        formats: sorted by name.
    """

    formats: tuple[ListedFormat, ...]


def listing(formats: Iterable[Format]) -> FormatListing:
    """Make the listing of formats."""
    return FormatListing(formats=tuple(map(_listed_format, formats)))


def _listed_format(record: Format) -> ListedFormat:
    return ListedFormat(
        name=record.name,
        title=record.title,
        programs=tuple(program for program, names in PROGRAMS.items() if record.name in names),
        suffixes=tuple(record.suffixes),
        reads=record.read is not None,
        writes=record.write is not None,
        updates=record.updated,
        refuses=record.refuses,
        needs_image_size=record.needs_image_size,
        convention=tuple(record.convention.sentences()) if record.convention is not None else None,
        states=record.states,
        options={option.name: tuple(option.values) for option in record.options},
        questions={option.name: option.meaning for option in record.options},
        reference=record.reference,
    )
