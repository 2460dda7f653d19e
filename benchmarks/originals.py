"""Are originals told from what programs made of them? Two rates, over real images and real programs.

    python -m benchmarks.originals FOLDER [--quick] [--each N] [-v]

FOLDER holds the images of benchmarks/real_sets.csv as ``<owner>+<repository>/<path>``; those that are missing are
counted and left out. The table states for each its truth and how that is known; no image is part of this project.
Printed are, for the part that the rules were tuned on and for the part that was kept aside:

* originals that are suspected, alone and within their folder: at most 1 %;
* manipulations that are seen: at least 95 %. They are made of the originals, by the programs that are installed
  (ImageMagick, Pillow, jpegtran, ExifTool, darktable, RawTherapee, Hugin), each alone and as one file among untouched
  ones;
* the time of the processor that reading and judging one image takes.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from calibrary.catalogue import load_catalogue, match_image
from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import Pixels, no_frame, originality, usual_of
from calibrary.parsers.imagery import read_metadata

TABLE = Path(__file__).with_name("real_sets.csv")
ORIGINAL = "original"
SOURCES_OF_EACH = 3
"""Originals that each kind of manipulation is made of, of each part."""
LARGEST_SOURCE_BYTES = 6_000_000
OTHERS = 6
"""Untouched images of the same camera that a manipulation is put among, if there are as many."""


class Row(NamedTuple):
    """One image of the table."""

    path: Path
    truth: str
    part: str


class Made(NamedTuple):
    """One manipulated image, and the untouched ones of its folder."""

    kind: str
    path: Path
    source: Path
    part: str


def read_table(folder: Path) -> tuple[list[Row], int]:
    """The images that are there, and the number of those that are not."""
    found, missing = [], 0
    with TABLE.open(newline="") as lines:
        for line in csv.DictReader(lines):
            path = folder / line["repository"].replace("/", "+", 1) / line["path"]
            if path.is_file():
                found.append(Row(path, line["truth"], line["part"]))
            else:
                missing += 1
    return found, missing


def is_suspected(metadata: ImageMetadata, flight: Iterable[ImageMetadata] = ()) -> bool:
    """Whether an image is not taken for an original, alone or among others."""
    usual = usual_of(Counter([metadata, *flight])).get(metadata) if flight else None
    found = originality(metadata, match_image(load_catalogue(), metadata).camera, usual)
    return no_frame(metadata) is not None or found.pixels in {Pixels.RESAVED, Pixels.ALTERED}


def run(*words: str | Path) -> None:
    """Run a program quietly; what it did not write, or not in time, is missed later."""
    with suppress(subprocess.TimeoutExpired):
        subprocess.run([*map(str, words)], capture_output=True, timeout=180, check=False)


def tags(*words: str | Path) -> None:
    """Run ExifTool on a file in place."""
    run("exiftool", "-q", "-m", "-overwrite_original", *words)


def box(path: Path, share: float, *, step: int = 2) -> tuple[int, int, int, int]:
    """A centred part of an image with its proportions: width, height, left, top."""
    with Image.open(path) as image:
        width, height = image.size
    across, down = (int(side * share) // step * step for side in (width, height))
    return across, down, (width - across) // 2 // 16 * 16, (height - down) // 2 // 16 * 16


def geometry(part: tuple[int, int, int, int]) -> str:
    """As ImageMagick and jpegtran write it."""
    return "{}x{}+{}+{}".format(*part)


def im_crop(source: Path, out: Path, share: float) -> None:
    """Crop with ImageMagick, which keeps EXIF and its sizes."""
    run("convert", source, "-crop", geometry(box(source, share)), "+repage", out)


def im_resize(source: Path, out: Path) -> None:
    """Halve with ImageMagick."""
    run("convert", source, "-resize", "50%", out)


def im_crop_and_enlarge(source: Path, out: Path) -> None:
    """Crop, and enlarge to the size before."""
    whole = box(source, 1.0)
    run(
        "convert",
        source,
        "-crop",
        geometry(box(source, 0.7)),
        "+repage",
        "-resize",
        f"{whole[0]}x{whole[1]}!",
        out,
    )


def im_barrel(source: Path, out: Path) -> None:
    """Correct a lens by hand."""
    run("convert", source, "-distort", "barrel", "0 0 -0.06 1.06", out)


def im_straighten(source: Path, out: Path) -> None:
    """Turn by two degrees."""
    run("convert", source, "-distort", "SRT", "1.05 2", out)


def pil(source: Path, out: Path, *, share: float = 1.0, to: float = 1.0) -> None:
    """Save with Pillow, as a whole or a part, with the EXIF block as it was."""
    with Image.open(source) as image:
        across, down, left, top = box(source, share)
        cut = image.crop((left, top, left + across, top + down)) if share < 1 else image
        cut = cut.resize((int(cut.width * to), int(cut.height * to))) if to < 1 else cut
        exif = image.info.get("exif")
        cut.save(out, quality=93, **({"exif": exif} if exif else {}))


def pil_crop_and_sizes(source: Path, out: Path) -> None:
    """Crop, and make EXIF state the new size."""
    pil(source, out, share=0.75)
    with_sizes(out)


def with_sizes(path: Path) -> None:
    """Make EXIF state the file's size, as careful programs do."""
    across, down, *_ = box(path, 1.0)
    tags(f"-ExifImageWidth={across}", f"-ExifImageHeight={down}", path)


def careful_crop(source: Path, out: Path) -> None:
    """All sizes rewritten, no JFIF, a new thumbnail, sides that are multiples of 16."""
    with Image.open(source) as image:
        across, down, left, top = box(source, 0.75, step=16)
        cut = image.crop((left, top, left + across, top + down))
        exif = image.info.get("exif")
        cut.save(out, quality=95, **({"exif": exif} if exif else {}))
        cut.thumbnail((160, 160))
        small = out.with_suffix(".small.jpg")
        cut.save(small)
    with_sizes(out)
    tags("-RelatedImageWidth=", "-RelatedImageHeight=", "-JFIF:all=", f"-ThumbnailImage<={small}", out)
    small.unlink()


def fresh_crop(source: Path, out: Path) -> None:
    """Cropped, with new EXIF of what a solver needs."""
    run("convert", source, "-crop", geometry(box(source, 0.75)), "+repage", "-strip", out)
    tags(
        "-TagsFromFile",
        source,
        "-Make",
        "-Model",
        "-FocalLength",
        "-FocalLengthIn35mmFormat",
        "-DateTimeOriginal",
        out,
    )
    with_sizes(out)


def copied_crop(source: Path, out: Path) -> None:
    """Cropped by a program that knows no tags, then all tags copied."""
    run("convert", source, "-crop", geometry(box(source, 0.8)), "+repage", "-strip", out)
    tags("-TagsFromFile", source, "-all:all", "-unsafe", out)


def jpegtran(source: Path, out: Path, *words: str) -> None:
    """Change the file without decoding it."""
    run("jpegtran", "-copy", "all", *words, "-outfile", out, source)


def lossless_crop(source: Path, out: Path) -> None:
    """Cut blocks off."""
    jpegtran(source, out, "-crop", geometry(box(source, 0.75, step=16)))


def lossless_crop_and_sizes(source: Path, out: Path) -> None:
    """Cut blocks off, rewrite all sizes, remove the thumbnail."""
    lossless_crop(source, out)
    with_sizes(out)
    tags("-RelatedImageWidth=", "-RelatedImageHeight=", "-IFD1:all=", out)


def darktable(source: Path, out: Path, *words: str) -> None:
    """Export, with the styles that a new installation applies."""
    with tempfile.TemporaryDirectory() as home:
        core = ("--core", "--library", ":memory:", "--configdir", home, "--disable-opencl", "-t", "1")
        run("darktable-cli", source, out, *words, *core)


def rawtherapee(source: Path, out: Path, profile: str) -> None:
    """Export with a profile of these lines."""
    with tempfile.NamedTemporaryFile("w", suffix=".pp3") as file:
        file.write(f"[Version]\nAppVersion=5.9\nVersion=349\n{profile}")
        file.flush()
        run("rawtherapee-cli", "-o", out, "-p", file.name, "-j92", "-Y", "-c", source)


def rt_crop(source: Path, out: Path) -> None:
    """Crop in a raw developer."""
    across, down, left, top = box(source, 0.8)
    rawtherapee(
        source, out, f"[Crop]\nEnabled=true\nX={left}\nY={top}\nW={across}\nH={down}\nFixedRatio=false\n"
    )


def hugin(source: Path, out: Path) -> None:
    """Project one image as a panorama program does, and copy the tags of the first image."""
    project, made = out.with_suffix(".pto"), out.with_suffix("")
    run("pto_gen", "-o", project, "-f", "60", source)
    run("pto_var", "--set", "b=-0.03,r=1.2", "-o", project, project)
    run("pano_modify", "--canvas=AUTO", "--fov=AUTO", "--crop=AUTO", "-o", project, project)
    run("nona", "-m", "JPEG", "-o", made, project)
    for name in (made.with_name(f"{made.name}0000.jpg"), made.with_suffix(".jpeg")):
        if name.exists():
            name.rename(out)
    project.unlink(missing_ok=True)
    if out.exists():
        tags("-TagsFromFile", source, "-all:all", "-unsafe", out)


def panorama(source: Path, out: Path) -> None:
    """As a camera's app or a stitching program marks it."""
    pil(source, out)
    tags("-XMP-GPano:ProjectionType=cylindrical", out)


def named(source: Path, out: Path, program: str) -> None:
    """Saved again by an encoder, under the name of a program that cannot be installed here."""
    pil(source, out)
    with_sizes(out)
    tags(f"-Software={program}", out)


def lightroom(source: Path, out: Path, *, crop: bool) -> None:
    """Export as the mobile app does, with a crop or a lens profile."""
    pil(source, out, share=0.9 if crop else 1.0)
    with_sizes(out)
    states = ("-XMP-crs:HasCrop=True",) if crop else ("-XMP-crs:LensProfileEnable=1",)
    tags("-Software=Adobe Lightroom 8.0.1 (iOS)", "-XMP-crs:AlreadyApplied=True", *states, out)


def tagged(source: Path, out: Path) -> None:
    """Write a position, and no pixel."""
    shutil.copy(source, out)
    tags("-GPSLatitude=47.1", "-GPSLatitudeRef=N", "-GPSLongitude=8.2", "-GPSLongitudeRef=E", out)


Maker = Callable[[Path, Path], None]

MANIPULATIONS: dict[str, Maker] = {
    "crop to 98 %, ImageMagick": lambda s, d: im_crop(s, d, 0.98),
    "crop to 90 %, ImageMagick": lambda s, d: im_crop(s, d, 0.9),
    "crop to 50 %, ImageMagick": lambda s, d: im_crop(s, d, 0.5),
    "crop to 25 %, ImageMagick": lambda s, d: im_crop(s, d, 0.25),
    "crop and enlarge, ImageMagick": im_crop_and_enlarge,
    "resize, ImageMagick": im_resize,
    "barrel, ImageMagick": im_barrel,
    "straighten, ImageMagick": im_straighten,
    "crop to 75 %, Pillow": lambda s, d: pil(s, d, share=0.75),
    "resize, Pillow": lambda s, d: pil(s, d, to=2 / 3),
    "saved again, Pillow": pil,
    "crop and EXIF sizes, Pillow": pil_crop_and_sizes,
    "careful crop, Pillow and ExifTool": careful_crop,
    "crop and new EXIF": fresh_crop,
    "crop and copied tags": copied_crop,
    "lossless crop, jpegtran": lossless_crop,
    "lossless crop and sizes, jpegtran": lossless_crop_and_sizes,
    "turn by 90°, jpegtran": lambda s, d: jpegtran(s, d, "-rotate", "90"),
    "export, darktable": darktable,
    "resize, darktable": lambda s, d: darktable(s, d, "--width", "1600", "--height", "1600"),
    "crop, RawTherapee": rt_crop,
    "distortion, RawTherapee": lambda s, d: rawtherapee(s, d, "[Distortion]\nAmount=0.08\n"),
    "projected, Hugin": hugin,
    "panorama": panorama,
    "DxO PhotoLab": lambda s, d: named(s, d, "DxO PhotoLab 6.3"),
    "Capture One": lambda s, d: named(s, d, "Capture One 22 Macintosh"),
    "ON1": lambda s, d: named(s, d, "ON1 Photo RAW 2023"),
    "Lightroom mobile, lens": lambda s, d: lightroom(s, d, crop=False),
    "Lightroom mobile, crop": lambda s, d: lightroom(s, d, crop=True),
}
"""Manipulations that change where pixels are, or may."""

TRACELESS: dict[str, Maker] = {
    "turn, jpegtran": lambda s, d: jpegtran(s, d, "-rotate", "180"),
    "mirror, jpegtran": lambda s, d: jpegtran(s, d, "-flip", "horizontal"),
}
"""What moves pixels and leaves the header as it was, mostly: no goal, for comparison."""

HARMLESS: dict[str, Maker] = {"GPS tags, ExifTool": tagged}
"""What leaves every pixel where it is."""


def manipulate(rows: Sequence[Row], kinds: dict[str, Maker], each: int, folder: Path) -> list[Made]:
    """Make ``each`` of every kind, of sources that change from kind to kind."""
    made = []
    sources = [row for row in rows if row.path.stat().st_size < LARGEST_SOURCE_BYTES]
    cameras: dict[tuple[str | None, str | None], Row] = {}
    for row in sources:
        metadata = read_metadata(row.path)
        if min(metadata.size) >= 480:
            cameras.setdefault((metadata.make, metadata.model), row)
    chosen = list(cameras.values())
    for place, (kind, make) in enumerate(kinds.items()):
        for number in range(min(each, len(chosen))):
            row = chosen[(place * each + number) % len(chosen)]
            out = folder / f"{place:02}-{number:02}-{row.part.replace(' ', '')}.jpg"
            try:
                make(row.path, out)
            except OSError as error:
                print(f"{kind} of {row.path.name}: {error}")
            if out.exists() and out.stat().st_size:
                made.append(Made(kind, out, row.path, row.part))
            else:
                print(f"not made: {kind} of {row.path.name}")
    return made


def flight_of(source: Path, make: str | None, model: str | None) -> list[ImageMetadata]:
    """Untouched images of the same camera in the folder of the source; none if they are too few."""
    found: list[ImageMetadata] = []
    for path in sorted(source.parent.glob("*.[jJ][pP]*[gG]")):
        if path == source or len(found) == OTHERS:
            continue
        try:
            metadata = read_metadata(path)
        except InputError:
            continue
        if (metadata.make, metadata.model) == (make, model):
            found.append(metadata)
    return found if len(found) == OTHERS else []


def show_originals(rows: Sequence[Row], part: str, *, verbose: bool) -> None:
    """Print how many originals of a part are suspected."""
    by_folder: dict[Path, list[tuple[Path, ImageMetadata]]] = {}
    for row in rows:
        if row.part == part and row.truth == ORIGINAL:
            by_folder.setdefault(row.path.parent, []).append((row.path, read_metadata(row.path)))
    images = [one for group in by_folder.values() for one in group]
    alone = [path for path, metadata in images if is_suspected(metadata)]
    within = [
        path
        for group in by_folder.values()
        for path, metadata in group
        if is_suspected(metadata, [other for at, other in group if at != path])
    ]
    cameras = len({(metadata.make, metadata.model) for _, metadata in images})
    count = max(len(images), 1)
    print(
        f"{part}: {len(images)} originals of {cameras} cameras, suspected "
        f"{len(alone)} ({len(alone) / count:.1%}) alone, {len(within)} ({len(within) / count:.1%}) within their folder"
    )
    for path in dict.fromkeys([*alone, *within]) if verbose else ():
        print(f"  {path}: {originality(read_metadata(path)).seen}")


def show_manipulations(made: Sequence[Made], part: str, *, verbose: bool) -> None:
    """Print how many manipulations of a part are seen."""
    own = [one for one in made if one.part == part]
    seen, among, flights, missed = Counter[str](), 0, 0, []
    for one in own:
        try:
            metadata = read_metadata(one.path)
        except InputError:
            metadata = None
        found = metadata is None or is_suspected(metadata)
        seen[one.kind] += found
        source = read_metadata(one.source)
        if flight := flight_of(one.source, source.make, source.model):
            flights += 1
            among += metadata is None or is_suspected(metadata, flight)
        if not found:
            missed.append(one)
    count = max(len(own), 1)
    print(
        f"{part}: {len(own)} manipulations, seen {seen.total()} ({seen.total() / count:.1%}) alone; ", end=""
    )
    print(f"of {flights} among images of their flight {among} ({among / max(flights, 1):.1%})")
    for kind in dict.fromkeys(one.kind for one in own):
        print(f"  {seen[kind]} of {sum(one.kind == kind for one in own)}  {kind}")
    for one in missed if verbose else ():
        print(f"  missed: {one.kind} of {one.source}")


def show_cost(rows: Sequence[Row]) -> None:
    """Read and judge every image several times, with the files in memory."""
    catalogue, costs = load_catalogue(), []
    for _ in range(5):
        start = time.process_time()
        for row in rows:
            metadata = read_metadata(row.path)
            originality(metadata, match_image(catalogue, metadata).camera)
        costs.append((time.process_time() - start) / max(len(rows), 1))
    print(f"reading and judging one image: {min(costs) * 1000:.3f} ms of the processor")


def main() -> int:
    """Print both rates, for each part."""
    parser = argparse.ArgumentParser(description="Originals and manipulations of real images.")
    parser.add_argument("folder", nargs="?", type=Path, help="folder with the images of real_sets.csv")
    parser.add_argument(
        "--each", type=int, default=SOURCES_OF_EACH, help="sources of every kind, of each part"
    )
    parser.add_argument("--quick", action="store_true", help="one source of every kind")
    parser.add_argument("-v", action="store_true", help="name what is suspected and what is missed")
    arguments = parser.parse_args()
    if arguments.folder is None:
        print("no images of real_sets.csv here: nothing to measure")
        return 0
    rows, missing = read_table(arguments.folder)
    print(f"{len(rows)} images, {missing} missing")
    parts = sorted({row.part for row in rows}, reverse=True)
    with tempfile.TemporaryDirectory() as folder:
        for part in parts:
            show_originals(rows, part, verbose=arguments.v)
            own = [row for row in rows if row.part == part and row.truth == ORIGINAL]
            each = 1 if arguments.quick else arguments.each
            for name, kinds in (
                ("manipulations", MANIPULATIONS),
                ("without a trace", TRACELESS),
                ("harmless", HARMLESS),
            ):
                place = Path(folder, part, name)
                place.mkdir(parents=True)
                print(f"{name}:")
                show_manipulations(manipulate(own, kinds, each, place), part, verbose=arguments.v)
    show_cost(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
