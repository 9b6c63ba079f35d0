"""Writes the colour tables of this directory: `python3 generate.py` (needs matplotlib, cmcrameri).

Each table is a Rust array of 256 sRGB entries, as `include!`d by `colormap.rs`, with every digit
that the sources give.
"""

import pathlib

import matplotlib
from cmcrameri import cm

MATPLOTLIB = ["viridis", "magma", "inferno", "plasma", "cividis", "turbo"]
CRAMERI = ["batlow", "lajolla", "oslo", "devon", "hawaii", "vik", "roma", "berlin"]


def write(name, colors):
    assert len(colors) == 256
    rows = []
    for color in colors:
        rows.append("    [" + ", ".join(repr(round(float(c), 7)) for c in color[:3]) + "],\n")
        assert all(abs(float(c) - round(float(c), 7)) < 1e-15 for c in color[:3])
    path = pathlib.Path(__file__).with_name(name + ".in")
    path.write_text("[\n" + "".join(rows) + "]\n", encoding="ascii")


for name in MATPLOTLIB:
    write(name, matplotlib.colormaps[name].colors)
for name in CRAMERI:
    write(name, cm.cmaps[name].colors)
