#!/usr/bin/env python3
"""Reads a brick cache by docs/FORMAT.md alone, without deepfield, and checks every checksum.

    pip install numpy xxhash zstandard
    tools/read_cache.py CACHE.dfc

Prints the header as JSON. Exit code 1 and the first fault where the file is truncated, a checksum is
wrong, or counts of cells, parents, marks of void or the space between payloads contradict each other.
"""

import json
import pathlib
import struct
import sys

import numpy as np
from xxhash import xxh3_64_intdigest as digest
from zstandard import ZstdDecompressor, ZstdError

PAGE, NODE, FIELD = 65536, struct.Struct("<QQQIIIBBBB"), struct.Struct("<8Q4I9f4B")
EXISTS, REFINED, VOID, COARSER = 1, 2, 4, 16
# Where a field's record has these.
FLAGS, BLOCKS = 21, 22
# The lowest bit of values that each part of a payload tells.
PARTS = 16, 12, 8, 0


def need(condition, reason):
    if not condition:
        sys.exit(f"error: {reason}")


class Numbers:
    """Little-endian numbers and strings, one after another."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, pattern):
        values = struct.unpack_from("<" + pattern, self.data, self.at)
        self.at += struct.calcsize("<" + pattern)
        return values[0] if len(values) == 1 else list(values)

    def text(self):
        return self.take(f"{self.take('I')}s").decode()

    def optional(self):
        value = self.take("d")
        return value if value == value else None  # NaN stands for none


def read_header(data):
    """The header as a dictionary, and its length."""
    magic, version, length, checksum = struct.unpack_from("<8sIIQ", data)
    need(magic == b"\x89DFC\r\n\x1a\n" and version == 8, "no cache of version 8")
    need(digest(data[24:length]) == checksum, "the header is damaged")
    body = Numbers(data[24:length])
    names = "file_bytes index_offset index_pages page_table_checksum".split()
    header = dict(zip(names, body.take("4Q")), checksum=f"{checksum:016x}")
    header |= {"left": body.take("3d"), "right": body.take("3d"), "root_cells": body.take("3Q")}
    header |= {"time": body.optional(), "brick_edge": body.take("I")}
    header |= {"max_parent_blocks": body.take("I"), "format": body.text()}
    names = "octree simulation first_node nodes grids cells leaf_cells".split()
    header["levels"] = [dict(zip(names, body.take("ii5Q"))) for _ in range(body.take("I"))]
    header["fields"] = [read_field(body) for _ in range(body.take("I"))]
    need(body.at == length - 24, "the header is longer than its content")
    return header, length


def read_field(body):
    field = {"name": body.text(), "units": body.text() or None, "to_cgs": body.optional()}
    field |= {"exponent": body.take("i"), "min": body.take("d"), "max": body.take("d")}
    field |= {"smallest_positive": body.optional()}
    names = "sum sum_as_stored nan_cells dropped_cells dropped_volume dropped_sum"
    names += " relative_error leaf_error"
    return field | dict(zip(names.split(), body.take("ddQQdddd")))


def read_records(data, header):
    """All bricks' records: (node record, field records)."""
    pages, size = header["index_pages"], NODE.size + len(header["fields"]) * FIELD.size
    table = data[header["index_offset"] + pages * PAGE :]
    need(len(data) == header["file_bytes"] and len(table) == 8 * pages, "wrong length")
    need(digest(table) == header["page_table_checksum"], "table is damaged")
    records, nodes = [], sum(level["nodes"] for level in header["levels"])
    for page, expected in enumerate(struct.unpack(f"<{pages}Q", table)):
        start = header["index_offset"] + page * PAGE
        members = data[start : start + PAGE]
        need(digest(members, seed=page) == expected, f"page {page} is damaged")
        for at in range(0, min(PAGE // size, nodes - len(records)) * size, size):
            of_fields = list(FIELD.iter_unpack(members[at + NODE.size : at + size]))
            records.append((NODE.unpack_from(members, at), of_fields))
    need(len(records) == nodes, "the index is too short")
    return records


def check_tree(records):
    """Children name their parents; counts beneath add up; parents fill void where children do."""
    for number, (node, fields) in enumerate(records):
        first, _, descendants, leaf, existing, refined, mask, depth = node[:8]
        octants = [octant for octant in range(8) if mask >> octant & 1]
        children = [node for node, _ in records[first : first + len(octants)]]
        need(all(c[1] == number for c in children), f"brick {number}: a stranger's child")
        need([c[8] for c in children] == octants, f"brick {number}: octants")
        need(descendants == sum(1 + c[2] for c in children), f"brick {number}: descendants")
        need(depth == max((1 + c[7] for c in children), default=0), f"brick {number}: depth")
        need(leaf == existing - refined, f"brick {number}: leaf cells")
        for _, children in records[first : first + len(octants)]:
            void = (c[FLAGS] & 8 <= f[FLAGS] & 8 for c, f in zip(children, fields))
            need(all(void), f"brick {number}: a child fills void")


def decode(data, number, field, record, edge):
    """States and values of one payload: all blocks, and the side of the first and the last."""
    seed = (number * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF) ^ field
    sides = [max(edge >> up, 1) + 2 for up in range(record[BLOCKS] + 1)]
    cells, raw = sum(side**3 for side in sides), []
    sizes = 3 * cells, (cells + 1) // 2, (cells + 1) // 2, cells
    for part, (offset, checksum, length) in enumerate(zip(record[:4], record[4:8], record[8:12])):
        stored, size = data[offset : offset + length], sizes[part]
        if stored:
            need(digest(stored, seed=seed ^ part << 32) == checksum, f"brick {number}: damaged")
            raw.append(ZstdDecompressor().decompress(stored, max_output_size=size))
        else:
            need(part and not checksum and not offset, f"brick {number}: a part is missing")
            raw.append(bytes(size))
        need(len(raw[-1]) == size, f"brick {number}: payload has another length")
    states = np.frombuffer(raw[0], np.uint8, cells)
    coded = sums(folded(raw[0][cells:]), sides).astype(np.uint16).astype(np.uint32) << 16
    for part in 1, 2:
        pairs = np.frombuffer(raw[part], np.uint8)
        digits = np.stack([pairs & 15, pairs >> 4]).T.ravel()[:cells]
        coded |= (sums(digits, sides) & 15).astype(np.uint32) << PARTS[part]
    coded |= np.frombuffer(raw[3], np.uint8)
    coded[states & EXISTS == 0] = 0
    values = [uncarry(coded >> lowest << lowest) for lowest in PARTS]
    check_errors(number, record, states, values)
    return states, values[-1], sides


def folded(planes):
    """Differences of the leading 16 bits: 0, -1, 1, -2, ... are told as 0, 1, 2, 3, ..."""
    low, high = np.frombuffer(planes, np.uint8).reshape(2, -1).astype(np.int64)
    number = high << 8 | low
    return number >> 1 ^ -(number & 1)


def sums(differences, sides):
    """Numbers of all blocks' cells, of differences along all three axes."""
    blocks, at = [], 0
    for side in sides:
        block = differences[at : at + side**3].astype(np.int64).reshape(side, side, side)
        blocks.append(block.cumsum(0).cumsum(1).cumsum(2).ravel())
        at += side**3
    return np.concatenate(blocks)


def uncarry(coded):
    """Values of the bits that are kept: digits of which the first bit is set are negative."""
    for middle in 0x8000, 0x800, 0x80:
        coded = coded - ((coded & np.uint32(middle)) << np.uint32(1))
    return coded.view("<f4")


def check_errors(number, record, states, values):
    """What values in fewer digits are off by."""
    errors = record[18:21]
    need(1 >= errors[0] >= errors[1] >= errors[2] >= 0, f"brick {number}: errors out of order")
    *fewer, full = (v[states & EXISTS > 0].astype(float) for v in values)
    for said, rounded, length in zip(errors, fewer, record[9:12]):
        rounded, limit = np.nan_to_num(rounded, nan=0.0), np.finfo("f4").max
        off = np.abs(np.clip(rounded, -limit, limit) - np.nan_to_num(full, nan=0.0))
        # 1 is no bound.
        bounded = (off <= said * np.abs(full)) | (said >= 1)
        need(bounded[~np.isnan(full)].all(), f"brick {number}: rounding")
        need((said > 0) == (length > 0), f"brick {number}: a part too many, or too few")


def check_cells(number, node, record, edge, states, values, sides):
    """Range, completeness, counts and children of one payload."""
    first, last = sides[0], sides[-1]
    held, nan = values[states & EXISTS > 0], bool(record[FLAGS] & 2)
    sound = (record[12] <= held) & (held <= record[13]) | (nan & np.isnan(held))
    need(sound.all(), f"brick {number}: a value lies outside its range")
    need(states[-(last**3) :].all(), f"brick {number}: its last block has holes")
    own = states[: first**3].reshape((first,) * 3)[1:-1, 1:-1, 1:-1]
    is_own = own & (EXISTS | COARSER) == EXISTS
    counts = [np.count_nonzero(is_own), np.count_nonzero(own & REFINED)]
    need(counts == list(node[4:6]), f"brick {number}: cells of another number")
    z, y, x = (2 * axis // edge for axis in np.nonzero(own & REFINED))
    octants = np.bitwise_or.reduce(1 << (x + 2 * y + 4 * z), initial=0)
    need(octants == node[6], f"brick {number}: refined cells without a child")


def is_filled(states, sides):
    """Whether a cell of the parent's shows something where one of the brick's is void."""
    own, above = (side**3 for side in sides[:2])
    own, above = states[:own], states[own : own + above]
    own, above = (s.reshape((n,) * 3)[1:-1, 1:-1, 1:-1] for s, n in zip((own, above), sides))
    for axis in range(3):
        above = np.repeat(above, 2, axis)
    return ((own & VOID > 0) & (above & VOID == 0)).any()


def main():
    data = pathlib.Path(sys.argv[1]).read_bytes()
    header, end = read_header(data)
    print(json.dumps(header, indent=2))
    records, edge = read_records(data, header), header["brick_edge"]
    check_tree(records)
    for number, (node, fields) in enumerate(records):
        for field, record in enumerate(fields):
            need(bool(record[FLAGS] & 1) == (record[8] == 0), f"brick {number}: void and stored")
            if record[8]:
                states, values, sides = decode(data, number, field, record, edge)
                check_cells(number, node, record, edge, states, values, sides)
                fills = len(sides) > 1 and is_filled(states, sides)
                says = records[node[1]][1][field][FLAGS] & 8
                need(says or not fills, f"brick {node[1]}: fills void without saying so")
                end += sum(record[8:12])
    padding = data[end : header["index_offset"]]
    need(len(padding) < PAGE and not any(padding), "bytes between payloads and index")
    print(f"sound: {len(records)} bricks, {header['index_pages']} pages, {len(data)} bytes")


if __name__ == "__main__":
    try:
        main()
    except (OSError, IndexError, ValueError, ZstdError, struct.error) as fault:
        sys.exit(f"error: {sys.argv[1]}: {fault}")
