"""Damage to serialised messages and bags, for tests of how they are read."""

import random
import struct
from pathlib import Path

REALS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e300, 1e7, 1e-320, -0.0, 1.0)
WHOLES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 10**9, 10**6, 65_536, 100)


def damage_bag(rng: random.Random, path: Path) -> None:
    """Damage one of the two files of a bag, in three of four cases the recorded one."""
    (recorded,) = (file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
    file = rng.choice([recorded] * 3 + [path / "metadata.yaml"])
    file.write_bytes(damaged_bytes(rng, file.read_bytes(), rng.choice([1, 16, 512, 4096])))


def damaged_bytes(rng: random.Random, raw: bytes, length: int) -> bytes:
    """Bytes with flipped bits, or cut off, or a piece overwritten, left out or inserted."""
    data, at = bytearray(raw), rng.randrange(len(raw))
    kind = rng.randrange(5)
    if kind == 0:
        for _ in range(rng.choice([1, 5, 30])):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        data[at : at + length] = rng.choice([b"\0", b"\xff"]) * length
    elif kind == 3:
        del data[at : at + length]
    else:
        data[at:at] = rng.randbytes(8) * length
    return bytes(data)


def damaged_message(rng: random.Random, raw: bytes) -> bytes:
    """A serialised message with a bad number, length, stamp or frame, or with other damage."""
    data, kind = bytearray(raw), rng.randrange(6)
    if kind == 0 and len(data) > 16:
        at = len(data) - 8 * rng.randint(1, len(data) // 8 - 1)
        number = rng.choice((*REALS, rng.uniform(-2.0, 2.0), 10.0 ** rng.uniform(-9, 9)))
        struct.pack_into("<d", data, at, number)
    elif kind == 1 and len(data) > 8:
        struct.pack_into("<I", data, 4 * rng.randrange(1, len(data) // 4), rng.choice(WHOLES))
    elif kind == 2 and len(data) > 12:
        struct.pack_into("<iI", data, 4, rng.randint(-(2**31), 2**31 - 1), rng.getrandbits(32))
    elif kind == 3 and len(data) > 12:
        (seconds,) = struct.unpack_from("<i", data, 4)
        later = seconds + rng.choice((-3600, -2, -1, 1, 2, 3600))
        struct.pack_into("<i", data, 4, max(-(2**31), min(later, 2**31 - 1)))
    elif kind == 4:
        data[20 : 20 + rng.randrange(12)] = rng.randbytes(8)  # in the frame's name
    else:
        return damaged_bytes(rng, raw, rng.choice([1, 8, 100, 10_000]))
    return bytes(data)
