"""Draw the noise of a simulated car's commands."""

import hashlib
import math
from typing import Tuple


def normals(seed: int, number: int) -> Tuple[float, float]:
    """Return two independent standard normal numbers for a command's number.

    The same arguments give the same numbers on every machine; numpy's generators may change from
    release to release. The numbers come from a hash by the Box-Muller transform.
    """
    digest = hashlib.blake2b(f"{seed} {number}".encode(), digest_size=16).digest()
    one, other = (int.from_bytes(half, "little") for half in (digest[:8], digest[8:]))
    radius = math.sqrt(-2.0 * math.log((one + 1) / 2**64))
    return radius * math.cos(math.tau * other / 2**64), radius * math.sin(math.tau * other / 2**64)
