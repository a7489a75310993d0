#!/bin/sh
# A toy tracker in shell and awk: an example of a program in the benchmark that is not in Python.
#
#   sh tests/toy_tracker.sh BENCHMARK SUITE > predictions/SUITE.csv
#   torchsphere benchmark score BENCHMARK predictions --name toy
#
# In each frame, the pixels far from the most frequent grey level are the ball, and the middle of their bounding box is
# its centre. Columns of rotation and uncertainty are left out. The script needs od and awk, images of 8 bit without
# compression, and a background of one grey level.
set -eu
bench=$1 suite=$2
index=$bench/suites.json images=$bench/$suite/frames.tif

# A value of the suite in suites.json, which has one value a line.
value() {
    awk -v suite="\"$suite\"" -v key="\"$1\":" '
        $1 == "\"name\":" { here = ($2 == suite ",") }
        here && $1 == key { sub(/,$/, "", $2); gsub(/"/, "", $2); print $2; exit }' "$index"
}
# A whole number in the image file, by its position and number of bytes (2 or 4). The first two bytes give the byte order.
order=$(od -An -c -N2 "$images" | tr -d ' ')
number() {
    od -An -v -tu1 "-j$1" "-N$2" "$images" |
    awk -v order="$order" '{ for (k = 1; k <= NF; k++) n = 256 * n + $(order == "MM" ? k : NF + 1 - k) } END { print n + 0 }'
}

frames=$(value frames) width=$(value width) height=$(value height)

# TIFF: the first directory is a list of entries of 12 bytes; number 273 holds the position of the grey levels.
directory=$(number 4 4)
entries=$(number "$directory" 2)
at=$((directory + 2))
until [ "$(number "$at" 2)" -eq 273 ]; do
    entries=$((entries - 1)) at=$((at + 12))
    [ "$entries" -gt 0 ] || { echo "$images: no strips" >&2; exit 1; }
done
start=$(number $((at + 8)) 4)
# With several strips the entry holds the position of a list.
[ "$(number $((at + 4)) 4)" -eq 1 ] || start=$(number "$start" 4)

echo "# suite: $suite"
echo "# checksum: $(value checksum)"
echo "frame,x_px,y_px"
od -An -v -tu1 "-w$width" "-j$start" "-N$((frames * width * height))" "$images" |
awk -v height="$height" '
    function finish(   level, often, x, y, box) {
        for (level in count) if (count[level] > count[often]) often = level
        for (y = 0; y < height; y++) {
            split(row[y], grey)
            for (x = 1; x <= NF; x++) if (grey[x] > often + 40 || grey[x] < often - 40) {
                if (!box++) { left = right = x; top = y }
                if (x < left) left = x
                if (x > right) right = x
                bottom = y
            }
        }
        # A ball that has left the image gives an empty row: lost.
        if (box) printf "%d,%.2f,%.2f\n", frame, (left + right) / 2 - 1, (top + bottom) / 2
        else printf "%d,,\n", frame
        split("", count); frame++
    }
    { for (k = 1; k <= NF; k++) count[$k]++; row[(NR - 1) % height] = $0 }
    NR % height == 0 { finish() }'
