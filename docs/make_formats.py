"""Write docs/formats.md and docs/distortion.md; ``make docs`` begins with this, a test keeps them fresh."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from calibrary import parsers
from calibrary.distortion import MODELS
from calibrary.distortion.described import document
from calibrary.parsers.discovery import PROGRAMS, listing

if TYPE_CHECKING:
    from docs.make_lenses import caption
else:
    # A program's own folder is where Python looks first.
    from make_lenses import caption

FOLDER: Final = Path(__file__).parent

FORMATS_HEAD: Final = """\
# Calibration files

`make docs` generates this page from the formats' own records. [distortion.md](distortion.md) explains the coefficients.
calibrary recognises a file by its content. If it cannot decide, `--format NAME` names the format.
`calibrary formats NAME` explains one: an example in its own words, how it counts, and the source of that.

Wherever a format is asked for, the name of a program stands for the format that it reads, as in `--to metashape`. If
it reads several, the suffix of the file chooses among them.

"""

UNREAD_HEAD: Final = """\
## Without a reader

Formats of the field for which there is neither a description that states every number nor a file to hold one against.
With the sample of the last column a reader can be written.

| format | what is known | sample that would be needed |
| --- | --- | --- |
"""
UNREAD: Final = (
    (
        "PHOTOMOD `.x-cam` (Racurs)",
        "focal length, principal point and distortion, with x to the right and y up; Metashape exports it",
        "one that Metashape exported, beside the same camera as Agisoft XML, with no coefficient at zero",
    ),
    (
        "BINGO, PAT-B, ORIMA",
        "focal length and principal point in mm stand in the project or the report; BINGO exports all its additional "
        "parameters together, lens, earth curvature and refraction, as the grid below",
        "a camera definition of each program, and the report of its adjustment",
    ),
    (
        "Z/I distortion grid `.dat` (ISAT, BINGO's BgExport)",
        "`begin gridgroup … begin gridpoints` and two places in mm for each point; it has no K",
        "one beside the `.ssk` that it belongs to, with a statement which of the two places is measured",
    ),
    ("Z/I camera `.ssk`", "it is read: `zi_ssk`", "one with its lens distortion switched on"),
    (
        "3DM CalibCam (ADAM Technology)",
        "coefficients in mm, as Australis has them; Metashape exports it as `.txt`",
        "one that Metashape exported, beside the same camera as Agisoft XML",
    ),
    (
        "CalCam `.cal`",
        "Metashape exports it; nothing else is public, and the CalCam of plasma physics is another program",
        "as for CalibCam",
    ),
)


def documents() -> dict[str, str]:
    """Both documents by their file names."""
    listed = listing(parsers.formats()).formats
    understood = [one for one in listed if one.refuses is None]
    refused = [one for one in listed if one.refuses is not None]
    programs = "\n".join(
        f"| `{program}` | {', '.join(f'`{name}`' for name in names)} |" for program, names in PROGRAMS.items()
    )
    rows = [
        f"| `{r.name}` | [{r.title}]({r.reference}) | {r.access} | {' '.join(r.suffixes)} |"
        for r in understood
    ]
    table = "\n".join(["| name | content | read, write | usual names |", "| --- | --- | --- | --- |", *rows])
    reasons = "\n".join(f"| `{r.name}` | {r.title} | {r.refuses} |" for r in refused)
    unread = "\n".join(f"| {name} | {known} | {sample} |" for name, known, sample in UNREAD)
    formats = (
        f"{FORMATS_HEAD}| program | format |\n| --- | --- |\n{programs}\n\n{table}\n\n"
        "## Recognised and refused\n\n"
        f"| name | content | reason, and what to do |\n| --- | --- | --- |\n{reasons}\n\n{UNREAD_HEAD}{unread}\n"
    )
    return {
        "formats.md": formats,
        "distortion.md": _with_pictures(
            document("`make docs` generates this page from the models' own descriptions.")
        ),
    }


def _with_pictures(text: str) -> str:
    """Each model's drawing below its heading."""
    for name in MODELS:
        text = text.replace(f"## {name}\n\n", f"## {name}\n\n![{caption(name)}](lenses/{name}.svg)\n\n")
    return text


if __name__ == "__main__":
    for name, text in documents().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
