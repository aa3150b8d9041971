"""Recognize the format of a log file by its first bytes, or else by its suffix."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from diffthrust._support.errors import InputError
from diffthrust._support.files import oddity


@dataclass(frozen=True)
class Kind:
    """A kind of file, told by its first bytes, or by its suffix.

    ``article`` is what it is called in a sentence; ``messages`` have separate time stamps.
    """

    article: str
    messages: bool = False
    begins: tuple[bytes, ...] = ()
    endings: tuple[str, ...] = ()


TEXT = Kind("a table of text")
PARQUET = Kind("a Parquet file", begins=(b"PAR1",), endings=(".parquet",))
EXCEL = Kind("an Excel file", begins=(b"PK\x03\x04",), endings=(".xlsx", ".xlsm"))
# MATLAB 7.3 puts a text header of 512 bytes in front of the signature of HDF5: `kind_of` looks
# there.
HDF5 = Kind("a MATLAB 7.3 or HDF5 file", begins=(b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3"))
MAT = Kind("a MATLAB file", begins=(b"MATLAB 5.0",), endings=(".mat",))
BAG = Kind("a ROS 2 bag", True, (b"SQLite format 3\0",), (".db3",))
MCAP = Kind("an MCAP file", True, (b"\x89MCAP0\r\n",), (".mcap",))
BAG_1 = Kind("a ROS 1 bag", True, (b"#ROSBAG V2.0",), (".bag",))
DATAFLASH = Kind("an ArduPilot DataFlash log", True, (b"\xa3\x95\x80",), (".bin",))
TELEMETRY = Kind("a MAVLink telemetry log", True, endings=(".tlog",))
ULOG = Kind("a PX4 ULog", True, (b"ULog\x01\x12\x35",), (".ulg",))

_KINDS = (PARQUET, EXCEL, HDF5, MAT, BAG, MCAP, BAG_1, DATAFLASH, TELEMETRY, ULOG)
_TEXT = (".csv", ".tsv", ".txt", ".dat")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
CONTROL = bytes([*range(9), *range(14, 32)])
"""Bytes that never occur in text: with one of them the file is a picture or an archive."""
_READ = (
    "tables (.csv and other text, .xlsx, .parquet, .mat, .h5) are read by read_log, bags of ROS, "
    ".mcap, .bin, .tlog and .ulg by read_robot_log."
)
_STRANGE = {
    b"\xd0\xcf\x11\xe0": ("an old Excel file (.xls)", "save it as .xlsx or CSV."),
    b"\x1f\x8b": ("a compressed file (gzip)", "unpack it first."),
    b"7z\xbc\xaf": ("a compressed file (7z)", "unpack it first."),
    b"\x28\xb5\x2f\xfd": ("a compressed file (zstd)", "unpack it first."),
    b"\x93NUMPY": ("an array of NumPy", "give its columns to dft.Log(time=..., inputs=...)."),
    b"{": ("JSON", "give its numbers to dft.Log(time=..., inputs=...), or export a table."),
    b"<": ("a page of HTML or XML", "export the log as a table, such as CSV."),
}


def is_bag(path: Path) -> bool:
    """Whether a path is a folder with the metadata of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file()


def kind_of(path: Path) -> Kind:
    """What kind of log a file is."""
    if what := oddity(path):
        raise InputError(f"{path}: expected a file, found {what}.", "name the file of a log.")
    try:
        if is_bag(path):
            return BAG
        is_folder, head = path.is_dir(), b""
        if not is_folder:
            with path.open("rb") as stream:
                head = stream.read(4096)
    except FileNotFoundError:
        raise InputError(
            f"{path}: expected a file, found none.", "check the folder and the name of the file."
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: the file cannot be opened ({error}).", "check its name and permissions."
        ) from None
    if is_folder:
        raise InputError(
            f"{path}: expected a file, found a folder.",
            "name the file; the folder of a ROS 2 bag has a metadata.yaml.",
        )
    if not head:
        raise InputError(
            f"{path.name}: expected a header and samples, found an empty file.",
            "check that the recording was saved.",
        )
    # .xlsx is a zip, and so are .ods, .npz and any archive: only Excel's has a folder xl/.
    if head.startswith(EXCEL.begins) and _is_other_archive(path):
        raise InputError(
            f"{path.name}: expected a log, found an archive (zip) that is no Excel file.",
            "unpack it first; save a spreadsheet of another kind as .xlsx or CSV.",
        )
    for kind in _KINDS:
        if head.startswith(kind.begins) or (kind is HDF5 and head[512:520] in kind.begins):
            return kind
    for begin, (what, mend) in _STRANGE.items():
        # b"\xef\xbb\xbf" is the byte order mark that Windows programs put before UTF-8.
        if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(begin):
            raise InputError(f"{path.name}: expected a log, found {what}.", mend)
    ending = path.suffix.lower()
    # Zeros at the end of a text were never written: the logger lost power.
    text = head[:2] in UTF_16 or not set(head.rstrip(b"\0") or head) & set(CONTROL)
    for kind in _KINDS:
        if ending in kind.endings and not (text and kind is not TELEMETRY):
            return kind
    if text or ending in (".csv", ".txt", ".tsv"):  # whose reader reports binary data
        return TEXT
    raise InputError(f"{path.name}: expected a log, found binary data of an unknown format.", _READ)


def is_log(path: Path) -> bool:
    """Whether a file is a log, judged by its first bytes, or for text by its suffix."""
    try:
        kind = kind_of(path)
    except InputError:
        return False
    return kind is not TEXT or path.suffix.lower() in _TEXT


def _is_other_archive(path: Path) -> bool:
    try:
        with ZipFile(path) as archive:
            return not any(name.startswith("xl/") for name in archive.namelist())
    except (BadZipFile, OSError, ValueError):  # a damaged archive: its reader reports it
        return False
