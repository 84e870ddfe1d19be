"""Control characters that a terminal must not obey; encodings are tested with the readers of files."""

from dmis.base.text import printable


def test_control_characters_are_shown():
    """Also the one-byte escape, text that turns its direction, and bytes of names that are not UTF-8."""
    assert printable("\x1b[2J\r\b\x9b31m \u202e\udcff\x7f") == r"\x1b[2J\r\x08\x9b31m \u202e\udcff\x7f"
    assert printable("sch\xf6n, \u65e5\u672c\n") == "sch\xf6n, \u65e5\u672c\n"
