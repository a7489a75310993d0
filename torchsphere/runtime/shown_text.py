"""Text from files and names of files, made safe to show: in a terminal, in a table, in a page."""

from __future__ import annotations


def shown(text: str) -> str:
    r"""The text with every character that is not printable as its escape: ``\x1b``, ``\n``, or ``\xe9`` for a byte.

    Names of files may hold the control sequences of a terminal, signs that reverse the direction of the text, and bytes
    that are not UTF-8, which Python keeps as surrogates and no file in UTF-8 can hold.
    """
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    code = ord(letter)
    return f"\\x{code - 0xDC00:02x}" if 0xDC80 <= code <= 0xDCFF else letter.encode("unicode_escape").decode("ascii")
