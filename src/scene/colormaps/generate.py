"""Writes the colour tables of this directory: `python3 generate.py` (needs matplotlib, cmcrameri).

Each table is a Rust array of 256 sRGB entries, as `include!`d by `colormap.rs`, with every digit
that the sources give. `matplotlib.in` holds matplotlib's other maps, each as few entries as give
all others by linear interpolation, to 1e-7.
"""

import pathlib

import matplotlib
import numpy
from cmcrameri import cm

HERE = pathlib.Path(__file__).parent
MATPLOTLIB = ["viridis", "magma", "inferno", "plasma", "cividis", "turbo", "berlin"]
CRAMERI = ["batlow", "lajolla", "oslo", "devon", "hawaii", "vik", "roma"]
CLOSE = 1e-7


def write(name, colors):
    assert len(colors) == 256
    rows = []
    for color in colors:
        rows.append("    [" + ", ".join(repr(round(float(c), 7)) for c in color[:3]) + "],\n")
        assert all(abs(float(c) - round(float(c), 7)) < 1e-15 for c in color[:3])
    (HERE / (name + ".in")).write_text("[\n" + "".join(rows) + "]\n", encoding="ascii")


def knots(table):
    """The entries between which all others are linear."""
    found, at = [0], 0
    while at < 255:
        end = at + 1
        while end < 255:
            share = ((numpy.arange(at, end + 2) - at) / (end + 1 - at))[:, None]
            line = table[at] + (table[end + 1] - table[at]) * share
            if numpy.abs(line - table[at : end + 2]).max() > CLOSE:
                break
            end += 1
        found.append(end)
        at = end
    return found


def rest():
    """matplotlib's other maps, reverse ones aside."""
    taken = {*MATPLOTLIB, *CRAMERI, "gray"}
    names = sorted(
        name
        for name in matplotlib.colormaps
        if not name.endswith("_r") and not name.startswith("cmc.") and name not in taken
    )
    lines = []
    for name in names:
        table = matplotlib.colormaps[name].resampled(256)(numpy.arange(256))[:, :3]
        table = numpy.round(table, 7)
        lines.append(f'    ("{name}", &[\n')
        for k in knots(table):
            lines.append(f"        ({k}, [" + ", ".join(repr(float(c)) for c in table[k]) + "]),\n")
        lines.append("    ]),\n")
    (HERE / "matplotlib.in").write_text("[\n" + "".join(lines) + "]\n", encoding="ascii")


for name in MATPLOTLIB:
    write(name, matplotlib.colormaps[name].colors)
for name in CRAMERI:
    write(name, cm.cmaps[name].colors)
rest()
