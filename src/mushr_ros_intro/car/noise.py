"""Draw the errors of a simulated car's commands."""

import hashlib
import math
from typing import Tuple


def normals(seed: int, tick: int) -> Tuple[float, float]:
    """Return two independent normal random numbers, the same for the same arguments anywhere.

    Box and Muller's method, on a hash; numpy's generators may change from release to release.
    """
    digest = hashlib.blake2b(f"{seed} {tick}".encode(), digest_size=16).digest()
    one, other = (int.from_bytes(half, "little") for half in (digest[:8], digest[8:]))
    radius = math.sqrt(-2.0 * math.log((one + 1) / 2**64))
    return radius * math.cos(math.tau * other / 2**64), radius * math.sin(math.tau * other / 2**64)
