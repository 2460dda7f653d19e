"""Whether an image's pixels are where the camera put them: original, touched, saved again, or cropped or resized.

K describes the frame as the camera wrote it. A program that crops it, turns it, resizes it or corrects its lens mostly
leaves the tags as they are, so what contradicts the camera's own way of writing is looked for:

* **sizes**: the file's against EXIF's, the interoperability directory's and those that the camera is known to write;
* **programs** that name themselves (:data:`PROGRAMS`), and what Adobe's crs: properties say was done.
  DJI's originals contain crs:HasSettings, HasCrop and AlreadyApplied with the value False, so their mere presence means
  nothing. If AlreadyApplied is missing, the edit counts as applied, because some programs leave it out;
* **encoding**: segments, tables, sampling and parts of EXIF that the maker's cameras do not write, or always write, and
  those in which the image differs from the others of its flight.

None may be seen in more than one of a hundred originals.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum, StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.metadata import Encoding, ImageMetadata
from calibrary.image_size import ImageSize, same_aspect
from calibrary.known_camera import KnownCamera


class Pixels(StrEnum):
    """What is known of an image's pixels, from best to worst."""

    ORIGINAL = "original"
    """Nothing shows that they were changed."""
    TOUCHED = "touched"
    """A program wrote tags, or saved the image and says itself that it neither cropped nor corrected it."""
    RESAVED = "resaved"
    """A program saved the image again; whether it kept the frame and the lens's distortion is unknown."""
    ALTERED = "cropped or resized"
    """The frame is not the one that the camera wrote."""


class Originality(Struct, frozen=True, kw_only=True):
    """The verdict on an image's pixels, with what was seen.

    Attributes:
        pixels: the verdict.
        seen: what shows it, each in words; empty for an original.
        lens_corrected: whether a program corrected the lens, or may have done so: the distortion is unknown.
        done: what was done, such as "cropped by an editor", to follow "the image was"; empty if K is not in doubt.
        moved: those of ``done`` that a program states itself, so that they are certain.
    """

    pixels: Pixels = Pixels.ORIGINAL
    seen: tuple[str, ...] = ()
    lens_corrected: bool = False
    done: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()


ORIGINAL: Final = Originality()


def not_described(K: Calibration, size: ImageSize, images: Sequence[Originality]) -> Iterator[Originality]:
    """Those of some images that a program changed since, so that a K which was measured on others may not be theirs.

    A K of their very size describes their frame, as far as that shows, but not if they state a crop themselves, nor a
    lens that was corrected since, unless it has no distortion and all of them were.

    Args:
        K: at the image size at which it was measured.
        size: of the images.
        images: what is known of them.
    """
    is_of_size = K.intrinsics.image_size == size
    is_of_corrected = isinstance(K.distortion, NoDistortion) and all(one.lens_corrected for one in images)
    for one in images:
        if one.done and (not is_of_size or one.moved or (one.lens_corrected and not is_of_corrected)):
            yield one


class Writing(NamedTuple):
    """How images of one camera are written; a program that saves them changes at least one of it."""

    encoding: Encoding | None
    byte_order: str | None
    has_maker_note: bool
    has_thumbnail: bool


_DIFFERENCES: Final = {
    "encoding": "its segments, its sampling or its tables",
    "byte_order": "the byte order of its EXIF",
    "has_maker_note": "its MakerNote",
    "has_thumbnail": "its thumbnail",
}


class Usual(Struct, frozen=True, kw_only=True):
    """How most images of one camera in a flight are written.

    Attributes:
        writing: that most of them share.
        count: how many do.
        images: of this camera in all.
    """

    writing: Writing
    count: int
    images: int


MOST: Final = 0.6
"""Share of a camera's images that must be written alike before one that is not is conspicuous."""
FEWEST: Final = 3
"""Images that must be written alike."""


class Maker(NamedTuple):
    """What the cameras of a maker write, as far as originals of its models agree.

    Attributes:
        make: how EXIF Make begins, in lower case.
        models: how EXIF Model begins; other models of the maker are older, phones, or not known.
        no_jfif: they do not begin with a JFIF segment.
        own_tables: their quantisation tables are not libjpeg's.
        one_segment: they write all quantisation tables into one segment, which libjpeg and what builds on it do not.
        maker_note: they write a MakerNote.
        thumbnail: they write a thumbnail.
        restarts: they write restart intervals.
        byte_order: of their EXIF, if it is always the same.
        preview: they write a second image, which MPF's segment names.
        widest_px: widest image that this was seen of, where one Model has several cameras.
    """

    make: str
    models: str = ""
    no_jfif: bool = False
    own_tables: bool = False
    one_segment: bool = False
    maker_note: bool = False
    thumbnail: bool = False
    restarts: bool = False
    byte_order: str | None = None
    preview: bool = False
    widest_px: int | None = None


MAKERS: Final = (
    Maker("apple", r"ip(?:hone|ad)", own_tables=True, byte_order=">"),
    Maker("apple", r"iphone (?:[6-9]|\d\d|x|se)", maker_note=True, restarts=True),
    Maker(
        "canon",
        no_jfif=True,
        own_tables=True,
        one_segment=True,
        maker_note=True,
        thumbnail=True,
        byte_order="<",
    ),
    Maker("casio", no_jfif=True, one_segment=True, thumbnail=True),
    Maker("dji", r"fc\d", no_jfif=True, one_segment=True, byte_order="<"),
    Maker("dji", r"m3td?$|m4t|h30t|zh20|mavic2-enterprise|xt s", no_jfif=True, widest_px=1280),
    Maker("dji", r"m3td?$|m30t|m4t|h30t|zh20|mavic2-enterprise", preview=True, widest_px=1280),
    Maker("eastman kodak", r"(?!.*clas)", no_jfif=True, one_segment=True, thumbnail=True),
    Maker("fujifilm", no_jfif=True, thumbnail=True, byte_order="<"),
    Maker("fujifilm", r"(?!ds-|dx-|mx-)", own_tables=True, one_segment=True, maker_note=True),
    Maker("konica minolta", no_jfif=True, one_segment=True, thumbnail=True),
    Maker("leica", no_jfif=True, one_segment=True, thumbnail=True),
    Maker("minolta", no_jfif=True, one_segment=True, thumbnail=True),
    Maker("nikon", no_jfif=True, one_segment=True, maker_note=True, thumbnail=True),
    Maker("nikon", r"nikon|coolpix", own_tables=True),
    Maker("olympus", no_jfif=True, one_segment=True, maker_note=True, thumbnail=True),
    Maker("om digital", no_jfif=True, one_segment=True, maker_note=True, thumbnail=True),
    Maker("panasonic", no_jfif=True, own_tables=True, thumbnail=True, restarts=True, byte_order="<"),
    Maker("panasonic", r"d[cm]c?-", one_segment=True, maker_note=True),
    Maker("parrot", r"sequoia|disco|anafi", no_jfif=True, byte_order=">"),
    Maker("pentax", no_jfif=True, own_tables=True, one_segment=True, maker_note=True, thumbnail=True),
    Maker("ricoh", no_jfif=True),
    Maker("samsung", r"sm-|samsung-sm|gt-i9|sc-", one_segment=True),
    Maker("sanyo", no_jfif=True, thumbnail=True),
    Maker("sony", r"dsc-|ilc|slt|nex|dslr|zv-|umc|hdr-|fdr-|mavica|cyber|dcr", no_jfif=True, thumbnail=True),
    Maker(
        "sony", r"dsc-|ilc|slt|nex|dslr|zv-|umc|hdr-|fdr-", one_segment=True, maker_note=True, byte_order="<"
    ),
)
"""Measured on originals of public repositories; all rows that fit a camera count."""

_MODELS: Final = {maker: re.compile(maker.models, re.IGNORECASE) for maker in MAKERS}
_SMALLEST_SIDE_PX: Final = 320
"""Smaller images are thumbnails, and of no camera's size."""


class _Trace(NamedTuple):
    """What shows that an image is not as the camera wrote it.

    Attributes:
        shows: the verdict that it leads to.
        text: what was seen.
        done: what it says was done, to follow "the image was"; None if the verdict says enough.
        lens_corrected: whether the distortion is unknown because of it.
    """

    shows: Pixels
    text: str
    done: str | None = None
    lens_corrected: bool = False


# Cached: images of one camera are judged alike, and several commands ask of the same ones.
@lru_cache(maxsize=1024)
def originality(
    metadata: ImageMetadata, camera: KnownCamera | None = None, usual: Usual | None = None
) -> Originality:
    """Judge an image by its header.

    Args:
        metadata: of the image.
        camera: what the catalogue knows of its camera.
        usual: how most images of this camera in the flight are written.
    """
    traces = [*_sizes(metadata, camera), *_software_traces(metadata)]
    if not _is_kept(metadata) and metadata.whole_frame is not True:
        # A program that says what it did, and one that resized the whole frame, had to write the image anew.
        traces += _unlike_the_maker(metadata)
        traces += _unlike_the_flight(metadata, usual) if usual is not None else ()
    if not traces:
        return ORIGINAL
    pixels = max((trace.shows for trace in traces), key=_RANKS.__getitem__)
    return Originality(
        pixels=pixels,
        seen=tuple(dict.fromkeys(trace.text for trace in traces)),
        lens_corrected=any(trace.lens_corrected for trace in traces),
        done=_edits(pixels, traces),
        moved=tuple(trace.done for trace in traces if trace in _SAYS.values() and trace.done is not None),
    )


def _edits(pixels: Pixels, traces: Iterable[_Trace]) -> tuple[str, ...]:
    stated = tuple(dict.fromkeys(trace.done for trace in traces if trace.done is not None))
    if stated or pixels is not Pixels.RESAVED:
        return stated
    seen = ", and ".join(dict.fromkeys(trace.text for trace in traces if trace.shows is Pixels.RESAVED))
    return (f"saved again by a program, which may have changed its frame: {seen}",)


def _sizes(metadata: ImageMetadata, camera: KnownCamera | None) -> Iterator[_Trace]:
    """Sizes that are not those of the frame that the camera wrote."""
    size = metadata.size
    stated = {
        "EXIF": metadata.exif_size,
        "EXIF's interoperability directory": metadata.related_size,
        "EXIF's first directory": metadata.main_size if metadata.main_size != size[::-1] else None,
    }
    for name, other in stated.items():
        if other is None or other == size or _is_enlarged_thermal(size, other, camera):
            continue
        text = f"{name} states {_x(other)}, and the file has {_x(size)} px"
        if metadata.whole_frame is None or not same_aspect(other, size):
            yield _Trace(Pixels.ALTERED, text, f"{_what(other, size)}: {text}")
        elif metadata.whole_frame:
            yield _Trace(Pixels.ALTERED, f"{text}, which its thumbnail shows whole: it was resized")
        else:
            yield _Trace(Pixels.ALTERED, text, f"cropped: {text}, and its thumbnail shows more than they do")
        return
    written = _written_by(camera)
    is_thermal = camera is not None and camera.sub_camera == "thermal"
    upright = (max(size), min(size))
    # What lists a camera's modes lists those of photographs; it also takes some while it records a video.
    if written and size not in written and (is_thermal or upright not in {*written, *VIDEO}):
        known = ", ".join(_x(one) for one in written)
        text = f"it has {_x(size)} px, and this camera writes {known}"
        yield _Trace(Pixels.ALTERED, text, f"cropped or resized: {text}")
    elif metadata.encoding is not None and _is_no_mode_of(camera, size):
        frame = camera.native_size if camera is not None and camera.native_size is not None else size
        text = f"it has {_x(size)} px, which is no mode of this camera's frame of {_x(frame)}"
        yield _Trace(Pixels.ALTERED, text, f"cropped or resized: {text}")
    elif metadata.encoding is not None and metadata.make and (size[0] % 2 or size[1] % 2):
        text = f"{_x(size)} px is not a size that a camera writes, whose sides are even"
        yield _Trace(Pixels.ALTERED, text, f"cropped or resized: {text}")
    elif metadata.encoding is not None and metadata.encoding.sampling[:1] == ((1, 2),):
        text = "its chroma is halved in the other direction than cameras halve it"
        yield _Trace(Pixels.ALTERED, text, f"turned by 90°: {text}")
    elif (
        metadata.encoding is not None
        and metadata.encoding.turned_tables
        and not metadata.encoding.standard_tables
    ):
        text = "its quantisation tables are libjpeg's with rows and columns exchanged"
        yield _Trace(Pixels.ALTERED, text, f"turned by 90°: {text}")


def _written_by(camera: KnownCamera | None) -> tuple[ImageSize, ...]:
    """The sizes that a camera writes: those of the catalogue, and of a thermal camera its frame, plain or doubled.

    Such a camera hangs level in its gimbal, so that it also writes no portrait image.
    """
    if camera is None:
        return ()
    if camera.sizes or camera.sub_camera != "thermal" or camera.native_size is None:
        return camera.sizes
    width, height = camera.native_size
    return (width, height), (2 * width, 2 * height)


WHOLE_FRAMES: Final = frozenset({"dji", "hasselblad", "micasense"})
"""Makers whose cameras offer no smaller sizes, but the frame, its pixels joined, and these in another format."""
FORMATS: Final = (4 / 3, 3 / 2, 16 / 9, 1.0)
BINNINGS: Final = (0.5, 1, 2, 3, 4)
"""A list may state the frame of which a camera joins the pixels, or the joined one; small copies are halves, too."""
VIDEO: Final = frozenset(
    {
        (4096, 2160),
        (3840, 2160),
        (5120, 2700),
        (2688, 1512),
        (2720, 1530),
        (2704, 1520),
        (1920, 1080),
        (1280, 720),
    }
)
"""Sizes of images taken while the camera records a video."""
MODE_SLACK: Final = 0.01
"""Largest part of the longer side by which a mode is off: makers round sides to blocks of the encoder, and the frame
of a list may be a little larger than what is written (4032 px, and 4000 px in another format)."""


def _is_no_mode_of(camera: KnownCamera | None, size: ImageSize) -> bool:
    """Whether a camera of whole frames writes no such size: not its frame, joined pixels, or another format."""
    if camera is None or camera.native_size is None or camera.make.lower() not in WHOLE_FRAMES:
        return False
    long, short = max(size), min(size)
    if camera.sizes or short < _SMALLEST_SIDE_PX or (long, short) in VIDEO:
        return False
    for by in BINNINGS:
        width, height = (side / by for side in camera.native_size)
        frames = [(width, height), *((min(width, height * one), min(height, width / one)) for one in FORMATS)]
        if any(max(abs(long - a), abs(short - b)) <= MODE_SLACK * a for a, b in frames):
            return False
    return True


def _what(other: ImageSize, size: ImageSize) -> str:
    if same_aspect(other, size):
        return "resized, or cropped to the same proportions" if size[0] < other[0] else "enlarged"
    return "turned by 90°" if same_aspect(other, size[::-1]) else "cropped"


def _is_enlarged_thermal(size: ImageSize, other: ImageSize, camera: KnownCamera | None) -> bool:
    """Whether a thermal camera wrote its frame, or twice its frame, and the other of these into EXIF."""
    if camera is None or camera.sub_camera != "thermal" or camera.native_size is None:
        return False
    width, height = camera.native_size
    return {size, other} == {(width, height), (2 * width, 2 * height)}


def _software_traces(metadata: ImageMetadata) -> Iterator[_Trace]:
    """Programs that name themselves, and what crs: properties say."""
    yield from (_SAYS[edit] for edit in _applied(metadata))
    kept = _is_kept(metadata)
    for tag, program in _programs(metadata):
        text = f"{tag} names {program.name}"
        if kept or program.does is Does.TAGS:
            yield _Trace(Pixels.TOUCHED, text)
        elif program.does is Does.DEVELOPS:
            what = "which may have cropped it and corrected its lens: its distortion is unknown"
            done = f"developed by {program.name}, {what}"
            yield _Trace(Pixels.RESAVED, text, done, lens_corrected=True)
        else:
            yield _Trace(
                Pixels.RESAVED, text, f"saved by {program.name}, which may have cropped or resized it"
            )


_SAYS: Final = {
    "HasCrop": _Trace(
        Pixels.ALTERED,
        "crs: states a crop",
        "cropped by an editor, and the tags are of the image before that",
    ),
    "Lens": _Trace(
        Pixels.RESAVED,
        "crs: states a lens correction",
        "lens-corrected by an editor: its distortion is unknown",
        lens_corrected=True,
    ),
}
_LENS_CORRECTIONS: Final = ("LensProfileEnable", "LensManualDistortionAmount", "PerspectiveUpright")


def _applied(metadata: ImageMetadata) -> tuple[str, ...]:
    if _is_planned(metadata):
        return ()
    found = {
        "HasCrop": _is_set(metadata, "HasCrop"),
        "Lens": any(_is_set(metadata, name) for name in _LENS_CORRECTIONS),
    }
    return tuple(name for name, applied in found.items() if applied)


def _is_planned(metadata: ImageMetadata) -> bool:
    return (metadata.xmp_text("crs", "AlreadyApplied") or "").lower() in {"false", "0"}


def _is_set(metadata: ImageMetadata, name: str) -> bool:
    return (metadata.xmp_text("crs", name) or "false").lower() not in {"false", "0", "+0", "-0", "0.0"}


def _is_kept(metadata: ImageMetadata) -> bool:
    """Whether the program that developed the image states that it neither cropped it nor corrected its lens."""
    states = all(metadata.xmp_text("crs", name) is not None for name in ("HasCrop", "LensProfileEnable"))
    return states and not _is_planned(metadata) and not _applied(metadata)


def _programs(metadata: ImageMetadata) -> list[tuple[str, Program]]:
    texts = [
        ("EXIF Software", metadata.software),
        ("xmp:CreatorTool", metadata.xmp_text("xmp", "CreatorTool")),
    ]
    texts += [
        ("xmpMM:History", agent) for agent in metadata.xmp_values("xmpMM", "History/softwareAgent") or ()
    ]
    found = ((tag, program_in(text)) for tag, text in texts if text)
    return [(tag, program) for tag, program in found if program is not None]


def _unlike_the_maker(metadata: ImageMetadata) -> Iterator[_Trace]:
    """What the maker's cameras write otherwise."""
    encoding, make = metadata.encoding, (metadata.make or "").lower()
    if encoding is None or not make or min(metadata.size) < _SMALLEST_SIDE_PX:
        return
    if encoding.progressive:
        yield _Trace(Pixels.RESAVED, "its JPEG is progressive, which cameras do not write")
    if "Adobe" in encoding.segments:
        yield _Trace(Pixels.RESAVED, "it has a segment of Adobe's programs")
    if len(encoding.sampling) == 3 and set(encoding.sampling) == {(1, 1)}:
        yield _Trace(Pixels.RESAVED, "its chroma is not subsampled, as programs write it and cameras do not")
    if encoding.standard_tables and not encoding.standard_codes and not encoding.progressive:
        yield _Trace(
            Pixels.RESAVED,
            "its Huffman codes are computed for it beside libjpeg's tables, as programs do and cameras do not",
        )
    of = f"{(metadata.make or '').split()[0]} cameras"
    for maker in MAKERS:
        is_seen = maker.widest_px is None or max(metadata.size) <= maker.widest_px
        if is_seen and make.startswith(maker.make) and _MODELS[maker].match(metadata.model or ""):
            yield from (_Trace(Pixels.RESAVED, text) for text in _unlike(maker, metadata, encoding, of))


def _unlike(maker: Maker, metadata: ImageMetadata, encoding: Encoding, of: str) -> Iterator[str]:
    if maker.no_jfif and encoding.segments[:1] == ("JFIF",):
        yield f"it begins with a JFIF segment, which {of} do not write"
    if maker.own_tables and encoding.standard_tables:
        yield f"its quantisation tables are those of libjpeg, and {of} have their own"
    if maker.one_segment and encoding.split_tables:
        yield f"each of its quantisation tables has a segment of its own, and {of} write all into one"
    if maker.preview and "MPF" not in encoding.segments:
        yield f"its second image is missing, which {of} write"
    if maker.restarts and not encoding.restarts:
        yield f"it has no restart intervals, which {of} write"
    if not metadata.has_exif:
        return
    if maker.maker_note and not metadata.has_maker_note:
        yield f"its MakerNote is missing, which {of} write"
    if maker.thumbnail and not metadata.has_thumbnail:
        yield f"its thumbnail is missing, which {of} write"
    if maker.byte_order and metadata.byte_order not in {None, maker.byte_order}:
        yield f"its EXIF is in the other byte order than {of} write"


def _unlike_the_flight(metadata: ImageMetadata, usual: Usual) -> Iterator[_Trace]:
    own = _writing(metadata)
    apart = [
        _DIFFERENCES[name] for name, a, b in zip(Writing._fields, own, usual.writing, strict=True) if a != b
    ]
    if apart:
        more = f"{usual.count} of {usual.images} images of this camera are alike in"
        yield _Trace(Pixels.RESAVED, f"{more} {' and '.join(apart)}, and it is not")


def _writing(metadata: ImageMetadata) -> Writing:
    return Writing(metadata.encoding, metadata.byte_order, metadata.has_maker_note, metadata.has_thumbnail)


def usual_of(flight: Mapping[ImageMetadata, int]) -> dict[ImageMetadata, Usual]:
    """How most images of each camera are written, by the metadata of those that have a camera with enough images.

    Cameras are told apart by make, model and sub-camera, not by size, so that a cropped image is compared with the
    others. Images that betray themselves do not count among those that are alike.

    Args:
        flight: number of images by metadata.
    """
    groups: dict[tuple[str | None, ...], dict[ImageMetadata, int]] = {}
    for metadata, count in flight.items():
        if metadata.encoding is not None and metadata.model is not None:
            key = (metadata.make, metadata.model, metadata.sub_camera)
            groups.setdefault(key, {})[metadata] = count
    found: dict[ImageMetadata, Usual] = {}
    for group in groups.values():
        alike: Counter[Writing] = Counter()
        for metadata, count in group.items():
            if originality(metadata).pixels in {Pixels.ORIGINAL, Pixels.TOUCHED}:
                alike[_writing(metadata)] += count
        images = sum(group.values())
        for writing, count in alike.most_common(1):
            if count >= FEWEST and count >= MOST * images:
                found |= dict.fromkeys(group, Usual(writing=writing, count=count, images=images))
    return found


def no_frame(metadata: ImageMetadata) -> str | None:
    """Reason why a file is no frame of one camera that K could be of, or None: a panorama, or EXIF of another image."""
    projection = metadata.xmp_text("GPano", "ProjectionType")
    by = metadata.xmp_text("GPano", "StitchingSoftware")
    stitched = next((program for _, program in _programs(metadata) if program.does is Does.STITCHES), None)
    if projection is None and stitched is None:
        return exif_contradiction(metadata)
    name = by or (stitched.name if stitched is not None else None)
    shown = f"GPano states the projection {projection}" if projection else f"its tags name {name}"
    return f"it is a panorama ({shown}), which has no K of one camera; provide the images that it was made of"


def has_lens_correction(metadata: ImageMetadata) -> bool:
    """Whether a program corrected the lens, or may have done so, so that no distortion in the tags is the image's."""
    return originality(metadata).lens_corrected


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"


_RANKS: Final = {pixels: rank for rank, pixels in enumerate(Pixels)}


class Does(IntEnum):
    """What a program may have done to an image that it names itself in, in ascending order."""

    TAGS = 0
    """Writes tags, and copies the pixels as they are."""
    SAVES = 1
    """Saves the image again: it may have been cropped, turned or resized, and the tags do not say."""
    DEVELOPS = 2
    """As before, and corrects the lens by a profile, most of them without being asked."""
    STITCHES = 3
    """Joins several images to one, or projects them."""


class Program(Struct, frozen=True):
    """A program that an image names.

    Attributes:
        name: as the image writes it, version included.
        does: what it does to the geometry.
    """

    name: str
    does: Does


PROGRAMS: Final = {
    Does.STITCHES: r"ptgui|hugin|nona|enblend|autopano|kolor|image composite editor|autostitch|photostitch|panoweaver|"
    r"panorama ?(?:studio|maker|factory|stitcher)|realviz|dji (?:media maker|stitch)",
    Does.TAGS: r"exiftool|exiv2|geosetter|nikon transfer|pmb|playmemories|jhead|exifer|mapillary_tools",
    Does.DEVELOPS: r"lightroom|camera raw|dxo|darktable|rawtherapee|capture one|on1|luminar|affinity|silkypix|"
    r"capture nx\w*|nx studio|digital photo professional|phocus|photo ninja|aperture|raw power|iridient|lightzone|"
    r"rawstudio|ufraw|exposure x\d?|olympus (?:viewer|workspace)|om workspace|imaging edge|image data converter|"
    r"raw file converter|digital camera utility|sigma photo pro|zoner|pix4d\w*|metashape|photoscan|undistort\w*",
    Does.SAVES: r"adobe|photoshop|bridge|gimp|picasa|photo ?(?:viewer|gallery|editor|desk|scape|shop|works|suite)|"
    r"gallery|photos|windows(?! phone)|microsoft|paint(?:shop|\.net)?|irfanview|acdsee|acd systems|xnview\w*|"
    r"faststone|digikam|corel|polarr|snapseed|vsco|instagram|whatsapp|google|imagemagick|graphicsmagick|"
    r"graphicconverter|pillow|opencv|ffmpeg|quicktime|vuescan|noise ninja|viewnx\w*|(?:image|zoom)browser|"
    r"camedia master|finepixviewer|shotwell|gthumb|krita|pixelmator|preview|thumbsplus|meitu|picsart|topaz|skylum|"
    r"pixlr|canva|libvips|gd-jpeg|acorn|skitch",
}
"""What each program does, in the order in which they are searched for; a new program is a word here.

EXIF Software, XMP CreatorTool and the agents of XMP's history are searched. A camera writes its firmware into Software,
so a word names a program, and is no bare version.
"""

_ROWS: Final = [(does, re.compile(rf"\b(?:{names})\b", re.IGNORECASE)) for does, names in PROGRAMS.items()]


@lru_cache(maxsize=256)
def program_in(text: str) -> Program | None:
    """The program that a text names, or None for a camera's firmware and anything else.

    >>> program_in("Adobe Photoshop Lightroom Classic 12.0 (Windows)").does.name
    'DEVELOPS'
    >>> program_in("Acorn version 4.5.5").does.name
    'SAVES'
    >>> program_in("v01.09.1691")
    """
    return next((Program(text, does) for does, names in _ROWS if names.search(text)), None)
