import codecs

import pytest

from pymc_ship.machine.text import EncodingError, utf8


def test_utf8_with_or_without_its_mark_is_text():
    assert utf8("δ\r\n".encode()) == utf8(codecs.BOM_UTF8 + "δ\r\n".encode()) == "δ\r\n"
    assert utf8(b"") == ""


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        ("time,u\n".encode("utf-16"), "it is UTF-16 text; save it as UTF-8"),
        (codecs.BOM_UTF16_BE + "time,u\n".encode("utf-16-be"), "it is UTF-16 text; save it as UTF-8"),
        ("time,u\n".encode("utf-32"), "it is UTF-32 text; save it as UTF-8"),
        ("time,u\n".encode("utf-16-le"), "it is UTF-16 text or no text, line 1 has a zero byte; save it as UTF-8"),
        (b"time\nu\0\n", "it is UTF-16 text or no text, line 2 has a zero byte; save it as UTF-8"),
        (b"time\n\xe9\n", "it is not UTF-8 text, line 2; save it as UTF-8"),
    ],
)
def test_what_is_no_utf8_is_named(raw, sentence):
    with pytest.raises(EncodingError) as error:
        utf8(raw)
    assert str(error.value) == sentence
