"""Numbers in text files."""


def number(text: str) -> float:
    """The value of a decimal number, `nan` or `inf`; raises ValueError for all else, also what Python reads, as 1_0."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"no decimal number: {text[:40]!r}")
    return float(text)
