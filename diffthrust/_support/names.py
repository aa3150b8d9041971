"""Names in messages: the nearest valid one for a misspelt name, and lists that stay short."""

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(word: str, options: Iterable[str], before: str = "") -> str:
    """The option that a misspelt word most likely meant, in words; empty where nothing is near."""
    unique = list(dict.fromkeys(options))
    lowered: dict[str, str] = {}
    for option in unique:
        lowered.setdefault(option.lower().strip(), option)
    written = word.lower().strip()
    near = get_close_matches(written, list(lowered), n=3, cutoff=0.5)
    if not near:
        return ""
    # letters that changed places first: of "pmw", rpm was said to be as near as pwm
    meant = max(near, key=lambda option: sorted(option) == sorted(written))
    return f"{before}the nearest is {lowered[meant]!r}"


def listing(names: Iterable[str], limit: int = 30) -> str:
    """Write names as ``'a', 'b' and 3 more``, so that a wide table does not flood the message."""
    return shortened(map(repr, names), limit) or "none"


def shortened(words: Iterable[str], limit: int) -> str:
    """Write words as ``a, b and 3 more``."""
    every = list(words)
    more = len(every) - limit
    return ", ".join(every[:limit]) + (f" and {more} more" if more > 0 else "")


def nearby(word: str, options: Iterable[str], most: int = 8) -> str:
    """What could have been written: all of it and the nearest if it is little, else the nearest."""
    names = list(dict.fromkeys(options))
    if len(names) <= most:
        return f"there are {listing(names)}{nearest(word, names, '; ')}"
    near = get_close_matches(word.lower().strip(), names, n=3, cutoff=0.4)
    return (
        f"of {len(names)} names the nearest are {listing(near)}"
        if near
        else (f"there are {len(names)} names, and none is near")
    )


def short_repr(value: object) -> str:
    """What was found, for a message: as Python writes it, cut where it is long."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, lists without end
        return f"{type(value).__name__} too long to be written"
    return text if len(text) < 80 else f"{text[:77]}..."
