"""Text of files, and text for terminals."""

from __future__ import annotations


def decode(data: bytes, name: str) -> str:
    r"""Return the text of the bytes of a file: of UTF-8, with or without a mark in front, else of Latin-1; lines end
    with ``\n``. A ValueError that begins with `name` if it is UTF-16 or binary.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data:
        raise ValueError(f"{name} is UTF-16 or binary; it must be text, save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:  # in comments and names
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def printable(text: str) -> str:
    r"""Return a text in which control characters, but ends of lines, are written as in Python, such as ``\x1b``.

    A terminal obeys the characters themselves, and a file may have them in its name or in its words.
    """
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)
