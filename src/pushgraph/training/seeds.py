"""Seeds of random numbers, made of what they are for."""

import hashlib


def seed_of(purpose: str, **fields: int) -> int:
    """A seed from 0 to 2^63 - 1, the same in every process and version of Python; other fields, other numbers."""
    text = " ".join([purpose, *(f"{name}={value}" for name, value in sorted(fields.items()))])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 1
