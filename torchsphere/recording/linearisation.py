"""The camera maker's table from 10-bit packed CINE codes to linear 12-bit grey levels.

Phantom cameras that save 10 bits per pixel do not drop two bits of their 12-bit image, they compress it: nearly one
level per code in the dark, eight levels per code at the bright end. The same 1024 numbers stand in programs written
apart from each other: the areaDetector driver for these cameras (ADPhantom), NASA's uPSP reader, MUVI and pycine.
They map code 64 to level 64 (black), code 1014 to level 4064 (white) and code 451 to level 781. A reader that reports
734 for that code uses the same table and then stretches 64..4064 to 0..4095: (781 - 64) * 4095 / 4000 = 734. That is a
change of contrast, not part of the table, and it is not repeated here: levels stay the camera's own.

The curve follows a power law like that of Rec. 709 to about one level, but no formula that was tried gives every
rounded entry, so the table is stored: its first entry, then the steps from each entry to the next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_FIRST = 2
# One digit per step, for codes 1 to 1014.
_STEPS = (
    "311111111111101111111111111111011111111111111101111111111111110111111111111111101111111111111110"
    "111111111111111101111111111111110111111111111011111111111111111211111111121111112111121112111211"
    "121121121121121211212121121212121212122121221212212212212212221222122212222212222222122222222222"
    "222222222222322222223222223222322232223223223223223232322323232323232323323232332332332332333233"
    "323332333332333333332333333333333333333343333333343333433334333433433343343433434334343434343434"
    "343443434434434434434443444344443444444344444444444444444444444444544444544445444544454454454454"
    "454545445454545454554545455455455455455545554555545555554555555555555555555555555565555556555565"
    "556555655655655656556565656565656565656656656566566656665666566665666666665666666666666667666666"
    "667666676666766676676676676766767676767676767676776767767767776777677767777767777777777767777787"
    "777777777787777787777877787787787787787878778787878788787878878878878878887888878888878888888888"
    "888888888888888988888988889888988988988988989898898988"
)
# Codes above white.
_SATURATED = 4095

TABLE_NOTE = (
    "10-bit values were linearised to 12 bit with the camera maker's CINE table, as ADPhantom and pycine hold it "
    "(64 is black, 4064 white; not stretched further)."
)


def linear_12_bit() -> NDArray[np.uint16]:
    """Give the 12-bit level of every 10-bit code.

    Returns
    -------
    ndarray of uint16, shape (1024,)
    """
    table = np.full(1024, _SATURATED, np.uint16)
    steps = np.frombuffer(_STEPS.encode("ascii"), np.uint8) - ord("0")
    table[: steps.size + 1] = _FIRST + np.concatenate([[0], np.cumsum(steps, dtype=np.uint16)])
    return table
