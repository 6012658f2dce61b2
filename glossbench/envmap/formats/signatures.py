"""Recognises the format of a file by its first bytes, whatever its name is."""

from typing import NamedTuple


class Signature(NamedTuple):
    """A format, its bytes at an offset, and the extension under which it can be read; "" if it cannot be read."""

    kind: str
    start: bytes
    extension: str = ""
    offset: int = 0


_SIGNATURES = (
    Signature("an OpenEXR image", b"\x76\x2f\x31\x01", ".exr"),
    Signature("a Radiance HDR image", b"#?", ".hdr"),
    Signature("a portable float map", b"PF", ".pfm"),
    Signature("a portable float map", b"Pf", ".pfm"),
    Signature("a DDS cube map", b"DDS ", ".dds"),
    Signature("a PNG image", b"\x89PNG", ".png"),
    Signature("a JPEG image", b"\xff\xd8\xff", ".jpg"),
    *(Signature("a TIFF image", start, ".tif") for start in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")),
    Signature("a WebP image", b"WEBP", offset=8),
    Signature("an AVIF image", b"ftypavi", offset=4),
    Signature("a HEIF image", b"ftyp", offset=4),
    Signature("a KTX texture", b"\xabKTX 11"),
    Signature("a KTX 2 texture", b"\xabKTX 20"),
    Signature("a JPEG XL image", b"\xff\x0a"),
    Signature("a JPEG XL image", b"\0\0\0\x0cJXL "),
    Signature("a JPEG 2000 image", b"\0\0\0\x0cjP  "),
    Signature("a GIF image", b"GIF8"),
    Signature("a BMP image", b"BM"),
    Signature("a Photoshop document", b"8BPS"),
    Signature("a portable pixmap", b"P6"),
    Signature("a ZIP archive", b"PK\x03\x04"),
    Signature("a gzip archive", b"\x1f\x8b"),
    Signature("a web page", b"<!DOCTYPE"),
    Signature("a web page", b"<!doctype"),
    Signature("a web page", b"<html"),
    Signature("the name of a file that Git LFS keeps elsewhere", b"version https://"),
)
_NO_IMAGE = {
    "a ZIP archive": "unpack it", "a gzip archive": "unpack it", "a web page": "download the image itself",
    "the name of a file that Git LFS keeps elsewhere": "fetch it by git lfs pull",
}  # fmt: skip


def recognise(head: bytes) -> Signature | None:
    """The format of a file with these first bytes; None if it is not known."""
    return next((s for s in _SIGNATURES if head[s.offset :].startswith(s.start)), None)


def advise(head: bytes) -> str:
    """The end of a sentence that names the format and what to do about it; "" if the format is not known."""
    found = recognise(head)
    if found is None:
        return ""
    name_it = f"name it {found.extension}" if found.extension else "convert it to .exr"
    return f", as {found.kind} does; {_NO_IMAGE.get(found.kind, name_it)}"
