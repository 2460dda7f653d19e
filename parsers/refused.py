"""File formats that are recognised and refused: what each is, how it is recognised, and what to do instead.

They share a suffix with calibrations (mostly ``.cal`` and ``.xml``) or come from the same programs, but none
of them contains a usable K: calibrations of other sensors, and unpublished formats. Examples of each::

    opf_document           {"format": "application/opf-camera-list+json", …}
    cahvor                 Model = CAHVOR = perspective, distortion
    calcam_cal             CalCam in the first lines; Metashape exports it and describes it nowhere
    ladybug_cal            camera0_rotX=…  camera0_FocalLen=…  camera0_CameraCenterX=…
    image_pro_cal          [SPATIAL]  CalibName=…  UnitName=…  PixPerUnit=10,10
    ptgui_project          {"project": {"globallenses": …}}, before version 11 "# ptGui project file"
    python_pickle          the bytes 80 04 95 …, or a .npy of Python objects
    calibrary_document     {"schema": "calibrary/truth-1", …}
    ale_isd                {"name_model": "USGS_ASTRO_FRAME_SENSOR_MODEL", "focal2pixel_lines": […], …}
    svo_settings           max_fts: 180  quality_min_fts: 40  map_scale: 1.5
    sensor_cal             accel_bias = …  gyro_scale = …  mag_offset_x = …; ArgyllCMS: CAL, DEVICE_CLASS "DISPLAY"

A row of :data:`REFUSED` is a format without ``read``; otherwise it is treated like any other format.
"""

from __future__ import annotations

import re

from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, Sniff, Sure
from calibrary.parsers.formats._npy import MAGIC, is_of_objects

OPF_READ = {
    "application/opf-calibrated-cameras+json",
    "application/opf-input-cameras+json",
    "application/opf-project+json",
}
IMAGE_PRO_KEYS = ("CALIBNAME=", "UNITNAME=", "PIXPERUNIT=", "IMAGECLASS=", "INPUTRANGE=")
FEWEST_WORDS = 2
"""Fewest words of another sensor at line starts that identify such a file; a single one may occur anywhere."""
SHARE = 0.2
"""Of the keys, so that a program's settings, of which some are about its sensors, are no calibration of them."""
SVO_KEYS = frozenset({"max_fts", "map_scale", "quality_min_fts", "max_n_kfs"})

_CAHVOR = re.compile(r"Model\s*=\s*(CAHV(?:OR)?E?)\b")
_CALCAM = re.compile(r"\bcalcam\b", re.IGNORECASE)
_POINT_GREY = re.compile(r"\b(?:ladybug|triclops|bumblebee|digiclops)", re.IGNORECASE)
_LADYBUG_KEY = re.compile(r"camera\d+_(?:FocalLen|CameraCenterX|rotX)\s*=", re.IGNORECASE)
_KEY = re.compile(r"\s*[\"']?([A-Za-z][\w .\-\[\]]{0,60}?)[\"']?\s*[=:,\s]")
_OTHER_SENSOR = re.compile(
    r"acc(?:el\w*)?|gyro\w*|mag(?:net\w*)?|imu|barom\w*|"
    r"radian\w*|irradian\w*|radiometr\w*|darkcurrent|vignett\w*|wavelengths?|reflectance\w*"
)
_PICKLE = re.compile(rb"\x80(?:[\x04\x05](\x95)|[\x02-\x05])")
_WORDS = re.compile(r"[^a-z]+")
_LENS_WORDS = ("focal", "principal", "distort", "camera_matrix", "intrinsic")
_LENS_NAMES = re.compile(r"^\s*k_|\b[fc][xy]\b|fc\b", re.MULTILINE)


def _opf(content: Content) -> Sniff | None:
    """Any OPF document except those that are read."""
    mark = content.json.get("format") if isinstance(content.json, dict) else None
    if isinstance(mark, str) and mark.startswith("application/opf-") and mark not in OPF_READ:
        return Sniff(Sure.MAGIC, f"its format is {strict.shown(mark)}")
    return None


def _cahvor(content: Content) -> Sniff | None:
    """Recognised by the line that names the model."""
    found = next((match for line in content.lines[:100] if (match := _CAHVOR.match(line))), None)
    return Sniff(Sure.MAGIC, f"it contains Model = {found[1]}") if found else None


def _calcam(content: Content) -> Sniff | None:
    """Recognised by its name in the first lines of plain text; the calcam of plasma physics writes .ccc archives."""
    if _is_plain(content) and any(_CALCAM.search(line) for line in content.lines[:5]):
        return Sniff(Sure.SHAPE, "its first lines name CalCam")
    return None


def _ladybug(content: Content) -> Sniff | None:
    """Recognised by numbered cameras in the vendor's spelling, or one of its products in the first line."""
    if not _is_plain(content):
        return None
    if any(_LADYBUG_KEY.match(line) for line in content.lines[:40]):
        return Sniff(Sure.MAGIC, "it contains camera0_FocalLen and the like, as Ladybug programs print them")
    product = _POINT_GREY.search(content.first_line)
    return Sniff(Sure.WEAK, f"the first line names {product[0]}") if product else None


def _image_pro(content: Content) -> Sniff | None:
    """Recognised by one of its two sections at the beginning, with one of its keys."""
    section = content.first_line.upper()
    if section in ("[SPATIAL]", "[INTENSITY]") and any(
        line.upper().startswith(IMAGE_PRO_KEYS) for line in content.lines[1:]
    ):
        return Sniff(Sure.MAGIC, f"it begins with the section {section}")
    return None


def _ptgui(content: Content) -> Sniff | None:
    """Recognised by the lenses in its JSON, or the first line of its older text format."""
    document = content.json
    if isinstance(document, dict):
        projects = (value for key, value in document.items() if "project" in key)
        if any(isinstance(value, dict) and "globallenses" in value for value in projects):
            return Sniff(Sure.MAGIC, "JSON with a project that has globallenses")
        return None
    found = content.first_line.lower().startswith("# ptgui project file")
    return Sniff(Sure.MAGIC, f"the first line is '{content.first_line[:40]}'") if found else None


def _pickle(content: Content) -> Sniff | None:
    """Recognised by the mark of protocol 2 or later (from 4 on with a frame) and the stop opcode at the end."""
    if content.data.startswith(MAGIC) and is_of_objects(content.data):
        return Sniff(Sure.MAGIC, "it is a numpy file whose elements are pickled Python objects")
    found = _PICKLE.match(content.data)
    if found and content.data.endswith(b"."):
        return Sniff(Sure.SHAPE if found[1] else Sure.WEAK, "it begins and ends as a Python pickle does")
    return None


def _other_sensor(content: Content) -> Sniff | None:
    """Recognised by keys of another sensor, without any of a lens."""
    if content.first_line.split()[:1] == ["CAL"] and "DEVICE_CLASS" in (content.text or ""):
        return Sniff(Sure.MAGIC, "it begins with CAL and contains DEVICE_CLASS, as ArgyllCMS writes displays")
    text = (content.text or "").lower()
    if not _is_plain(content) or any(word in text for word in _LENS_WORDS) or _LENS_NAMES.search(text):
        return None
    keys = [key for line in content.lines[:200] if (key := _KEY.match(line))]
    words = [word for key in keys for word in _WORDS.split(key[1].lower()) if _OTHER_SENSOR.fullmatch(word)]
    if len(words) >= max(FEWEST_WORDS, SHARE * len(keys)):
        return Sniff(
            Sure.WEAK, f"its keys are about {', '.join(dict.fromkeys(words[:4]))}, none about a lens"
        )
    return None


def _calibrary(content: Content) -> Sniff | None:
    """Recognised by its schema."""
    mark = content.json.get("schema") if isinstance(content.json, dict) else None
    if isinstance(mark, str) and mark.startswith("calibrary/"):
        return Sniff(Sure.MAGIC, f"its schema is {strict.shown(mark)}")
    return None


def _isd(content: Content) -> Sniff | None:
    """Recognised by the names of ALE's image support data."""
    if {"name_model", "focal2pixel_lines", "focal_length_model"} <= set(content.json_keys):
        return Sniff(Sure.MAGIC, "JSON with name_model, focal2pixel_lines and focal_length_model")
    return None


def _svo(content: Content) -> Sniff | None:
    """Recognised by SVO's names for the numbers of features and keyframes."""
    keys = {key[1] for line in content.lines[:200] if _is_plain(content) and (key := _KEY.match(line))}
    return (
        Sniff(Sure.MAGIC, f"its keys are SVO's {', '.join(sorted(SVO_KEYS))}") if keys >= SVO_KEYS else None
    )


def _is_plain(content: Content) -> bool:
    return not content.xml_tags and content.json is None


REFUSED = (
    Format(
        name="opf_document",
        title="an OPF document without camera intrinsics",
        suffixes=(".json",),
        syntaxes=(Syntax.JSON,),
        reference="https://pix4d.github.io/opf-spec/index.html",
        sniff=_opf,
        refuses="it contains no K. Read the project (.opf), its calibrated cameras (usually calibrated_cameras.json) "
        "or its input cameras instead",
    ),
    Format(
        name="cahvor",
        title="a CAHV, CAHVOR or CAHVORE camera",
        suffixes=(".cahvor", ".cahv", ".cahvore", ".cal"),
        syntaxes=(Syntax.TEXT,),
        reference="https://mrcal.secretsauce.net/mrcal-from-cahvor.html",
        sniff=_cahvor,
        refuses="its vectors mix the intrinsics with the pose, and its distortion has an axis of its own (Gennery, "
        "IJCV 68, 2006), which no other program's model has. Convert it with mrcal-from-cahvor, then to one of "
        "OpenCV's models with mrcal-convert-lensmodel, and read that",
    ),
    Format(
        name="calcam_cal",
        title="a CalCam camera calibration",
        suffixes=(".cal",),
        syntaxes=(Syntax.TEXT,),
        reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
        sniff=_calcam,
        refuses="no description of the format is public. In Metashape, export Agisoft XML instead "
        "(Tools ▸ Camera Calibration ▸ Save ▸ Agisoft Camera Calibration)",
    ),
    Format(
        name="ladybug_cal",
        title="a Ladybug or Triclops calibration",
        suffixes=(".cal", ".ini"),
        syntaxes=(Syntax.TEXT,),
        reference="https://www.teledynevisionsolutions.com/support/support-center/application-note/iis/geometric-vision-using-ladybug-cameras/",
        sniff=_ladybug,
        refuses="the manufacturer does not publish what the numbers mean, and each of the camera's heads is a "
        "wide-angle lens that K alone does not describe. Let the Ladybug SDK rectify the images and use the focal "
        "length and centre that it reports for them, or calibrate each head from photographs of a board",
    ),
    Format(
        name="image_pro_cal",
        title="an Image-Pro spatial and intensity calibration",
        suffixes=(".cal",),
        syntaxes=(Syntax.TEXT,),
        reference="https://mc-hakuto.jp/webhelp/appb_cal.htm",
        sniff=_image_pro,
        refuses="it states how many pixels make a unit of length on a specimen and how grey values scale, nothing "
        "about a lens or a focal length. Calibrate the camera from photographs of a board instead",
    ),
    Format(
        name="ptgui_project",
        title="a PTGui project",
        suffixes=(".pts",),
        syntaxes=(Syntax.JSON, Syntax.TEXT),
        reference="https://www.ptgui.com/support.html",
        sniff=_ptgui,
        refuses="what its lens parameters mean is not published. Optimise the images in Hugin and read its .pto, or "
        "calibrate the camera from photographs of a board",
    ),
    Format(
        name="python_pickle",
        title="a Python pickle",
        suffixes=(".pkl", ".pickle", ".p", ".npy"),
        reference="https://docs.python.org/3/library/pickle.html",
        sniff=_pickle,
        refuses="opening one runs whatever program is in it. Where you trust the file, save its numbers as a .npz and "
        "read that: c = numpy.load('camera.pkl', allow_pickle=True) and then "
        "numpy.savez('camera.npz', mtx=c['mtx'], dist=c['dist']), with the file's own keys",
    ),
    Format(
        name="calibrary_document",
        title="a document of calibrary",
        suffixes=(".json",),
        syntaxes=(Syntax.JSON,),
        reference="https://json-schema.org/specification",
        sniff=_calibrary,
        refuses="it is a result of calibrary's own, in which a camera may be part of more, not a calibration file. Let "
        "the command that made it write one; of truth.json, give the frames beside it to calibrary calibrate",
    ),
    Format(
        name="ale_isd",
        title="an image support data file of ALE for USGSCSM or ISIS",
        suffixes=(".json", ".isd"),
        syntaxes=(Syntax.JSON,),
        reference="https://ale.readthedocs.io/",
        sniff=_isd,
        refuses="it states a planetary camera by its detector and focal plane in mm, with lines or samples that may "
        "run backwards and a distortion of each mission's own kind, so that it has no K of its image. Use it with "
        "USGSCSM, or in ASP convert the camera with cam_gen to a pinhole .tsai and read that",
    ),
    Format(
        name="svo_settings",
        title="a settings file of SVO",
        suffixes=(".yaml", ".yml"),
        syntaxes=(Syntax.TEXT,),
        reference="https://github.com/uzh-rpg/rpg_svo_pro_open",
        sniff=_svo,
        refuses="it states how the program follows features, and nothing about the camera. Read the calibration that "
        "the program is started with, usually calib/*.yaml or the file that calib_name names",
    ),
    Format(
        name="sensor_cal",
        title="a calibration of another sensor (inertial, magnetic, radiometric or display)",
        suffixes=(".cal",),
        syntaxes=(Syntax.TEXT,),
        reference="https://www.argyllcms.com/doc/cal_format.html",
        sniff=_other_sensor,
        refuses="it states no focal length, principal point or distortion. Ask the camera's manufacturer for its "
        "geometric calibration, or calibrate it from photographs of a board",
    ),
)
"""The refused formats, those with a signature first."""
