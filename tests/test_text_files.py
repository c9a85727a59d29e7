"""Texts in the encodings in which editors write them."""

import codecs

import pytest

from proxops.systems.common import decoded

TEXT = "name: Ida\nmesh: größe.obj\n"
MARKS = {
    "utf-8": codecs.BOM_UTF8,
    "utf-16-le": codecs.BOM_UTF16_LE,
    "utf-16-be": codecs.BOM_UTF16_BE,
    "utf-32-le": codecs.BOM_UTF32_LE,
    "utf-32-be": codecs.BOM_UTF32_BE,
}


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", MARKS)
def test_a_byte_order_mark_is_honoured_and_removed(encoding, ending):
    written = TEXT.replace("\n", ending)
    assert decoded(MARKS[encoding] + written.encode(encoding)) == TEXT


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_a_text_without_a_mark_is_utf_8_or_else_latin_1(encoding):
    assert decoded(TEXT.encode(encoding)) == TEXT


@pytest.mark.parametrize("mark", MARKS.values())
def test_bytes_that_are_no_text_are_read_all_the_same(mark):
    broken = mark + b"\xd8\xff\x00\xdc\x81"
    assert decoded(broken) == broken.decode("latin-1")
