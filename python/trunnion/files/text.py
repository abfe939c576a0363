"""Text of a file, and where in it something stands."""

from trunnion.base.errors import FileFormatError

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def decode(name: str, raw: bytes) -> str:
    """Return the UTF-8 text of a file's bytes, every line end as a line feed.

    `name` is the file's name in the message of the FileFormatError that other bytes raise.
    """
    raw = raw.removeprefix(_BYTE_ORDER_MARK)
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line, column = position_of(_line_feeds(raw[: error.start].decode("utf-8")), None)
        raise FileFormatError(
            f"{name}:{line}:{column}: got the byte 0x{raw[error.start]:02x}, expected UTF-8 text"
        ) from None
    return _line_feeds(text)


def position_of(text: str, offset: int | None) -> tuple[int, int]:
    """Return line and column, both from 1, of an offset into a text (None: its end)."""
    before = text[:offset]
    return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1


def _line_feeds(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")
