"""Grey levels from colour, and from the packed pixels of 10 and 12 bits of high-speed cameras.

Phantom cameras compress their 12-bit levels to 10-bit codes: nearly one level per code in the dark, eight at the
bright end. ADPhantom (the areaDetector driver), NASA's uPSP reader, MUVI and pycine hold the same table of 1024 levels.
Code 64 has level 64 (black), 451 has 781, 1014 has 4064 (white). A reader that gives 734 for code 451 stretches the
levels 64..4064 to 0..4095 afterwards; here they stay. No formula gives every rounded level, so the table is stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Luma of ITU-R Recommendation BT.601, section 2.5.1, for red, green and blue.
REC_601 = (0.299, 0.587, 0.114)

GREY_NOTE = "Colour was converted to grey with the Rec. 601 weights 0.299 R + 0.587 G + 0.114 B."
ALPHA_NOTE = "The transparency channel was ignored."

# Level of code 0, then the step to each next code up to 1014, one digit each; codes above white are saturated.
_FIRST = 2
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
_SATURATED = 4095

TABLE_NOTE = (
    "10-bit values were linearised to 12 bit with the camera maker's CINE table, as ADPhantom and pycine hold it "
    "(64 is black, 4064 white; not stretched further)."
)


def to_grey(colour: NDArray[Any], *, reverse: bool = False) -> NDArray[np.float32]:
    """Grey levels (...) of colours (..., c): red, green, blue and further channels, or blue first if ``reverse``."""
    red, green, blue = REC_601[::-1] if reverse else REC_601
    grey: NDArray[np.float32] = np.multiply(colour[..., 0], np.float32(red), dtype=np.float32)
    grey += np.multiply(colour[..., 1], np.float32(green), dtype=np.float32)
    grey += np.multiply(colour[..., 2], np.float32(blue), dtype=np.float32)
    return grey


def linear_12_bit() -> NDArray[np.uint16]:
    """The 12-bit levels (1024,) of all 10-bit codes."""
    table = np.full(1024, _SATURATED, np.uint16)
    steps = np.frombuffer(_STEPS.encode("ascii"), np.uint8) - ord("0")
    table[: steps.size + 1] = _FIRST + np.concatenate([[0], np.cumsum(steps, dtype=np.uint16)])
    return table


def unpack_10(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack bytes (..., 5 m) into 10-bit values (..., 4 m), most significant bits first."""
    five = data.reshape(*data.shape[:-1], -1, 5)
    values = np.empty((*five.shape[:-1], 4), np.uint16)
    for k in range(4):
        high, low = five[..., k].astype(np.uint16), five[..., k + 1]
        # Value k starts at bit 2 k of byte k.
        values[..., k] = ((high << (2 * k + 2)) & 0x3FF) | (low >> (6 - 2 * k))
    return values.reshape(*data.shape[:-1], -1)


def unpack_12(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack bytes (..., 3 m) into 12-bit values (..., 2 m), most significant bits first."""
    three = data.reshape(*data.shape[:-1], -1, 3)
    values = np.empty((*three.shape[:-1], 2), np.uint16)
    first, middle, last = three[..., 0], three[..., 1], three[..., 2]
    np.left_shift(first, 4, out=values[..., 0], dtype=np.uint16)
    values[..., 0] |= middle >> 4
    np.left_shift(middle & 0x0F, 8, out=values[..., 1], dtype=np.uint16)
    values[..., 1] |= last
    return values.reshape(*data.shape[:-1], -1)
