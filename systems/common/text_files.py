"""Text files, in whatever encoding and with whatever line ends an editor wrote them."""

from __future__ import annotations

import codecs
import contextlib

# UTF-32 comes first: its mark for little-endian begins with that of UTF-16.
_MARKED = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (codecs.BOM_UTF8, "utf-8-sig"),
)


def decoded(content: bytes) -> str:
    """The text of a file, with a line feed at the end of each line.

    A byte-order mark says which encoding it is. Without one it is UTF-8, or else Latin-1, in which
    any bytes are a text.
    """
    encoding = next((name for mark, name in _MARKED if content.startswith(mark)), "utf-8")
    text = content.decode("latin-1")
    with contextlib.suppress(UnicodeDecodeError):
        text = content.decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")
