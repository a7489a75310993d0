"""Ground truth by rendering: recordings of a speckled ball whose motion is known exactly.

The renderer (Mitsuba 3) shares no line with `torchsphere`: a sign error in both would cancel out in every comparison.
The import needs NumPy and SciPy only; rendering needs the extra `render`. The package is called `render` in a checkout
and `torchsphere_render` in an installation, so its modules import each other by relative names.

Frames and signs: the camera frame is right-handed, x right, y down, z away from the camera; the centre of the image's
top-left pixel is (0, 0), and a pixel covers half a pixel to every side of its centre. Metres and seconds inside.
"""
