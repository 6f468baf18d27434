"""Event files as h5py and hdf5plugin write and read them.

hdf5_files.py write FOLDER   makes files of the same events in the layouts of DSEC and Metavision
hdf5_files.py read FILE      prints what is in a file of DSEC's layout, as JSON
"""

import json
import struct
import sys
from pathlib import Path

import h5py
import hdf5plugin
import numpy as np

COUNT = 40_000
OFFSET = 1_234_567_890_123
CHUNK = 16_384
ECF = 0x8ECF


def events():
    n = np.arange(COUNT, dtype=np.int64)
    t = n * n // 400 + n // 9000 * 70_000
    x = np.where(n % 5 < 3, n // 7 * 7 + n % 5, n * 7) % 640
    return t, x, n // 40 * 3 % 480, n // 3 % 2


def write_dsec(path, **compression):
    t, x, y, p = events()
    with h5py.File(path, "w") as file:
        group = file.create_group("events")
        for name, column, kind in [("t", t, "<u4"), ("x", x, "<u2"), ("y", y, "<u2"), ("p", p, "u1")]:
            # Chunks of unequal length, as h5py chooses them.
            chunk = {"t": 10_000, "x": 4_001, "y": 40_000, "p": 1_000}[name]
            group.create_dataset(name, data=column.astype(kind), chunks=(chunk,), **compression)
        file.create_dataset("t_offset", data=np.int64(OFFSET))
        file.create_dataset("ms_to_idx", data=np.searchsorted(t, np.arange(0, t[-1], 1000)).astype("<u8"))


def runs(values):
    edges = np.flatnonzero(np.diff(values)) + 1
    begins = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(values)]])
    return zip(values[begins].tolist(), (ends - begins).tolist())


def ecf(t, x, y, p, packing):
    """A chunk as Prophesee's filter packs it: in runs (0), with packed columns (1), or with all packed (2)."""
    out = bytearray(struct.pack("<Iq", len(t) << 2 | packing, t[0]))
    now = t[0]
    for time, count in runs(t):
        step, now = time - now, time
        if step >= 15:
            while step:
                out.append(0xF0 | step & 15)
                step >>= 4
        out += bytes([step << 4 | min(count, 15)]) + (struct.pack("<H", count) if count >= 15 else b"")
    fill = -len(t) % 4
    x4, y4, p4 = (np.concatenate([v, np.repeat(v[-1], fill)]).astype(np.uint32) for v in (x, y, p))
    if packing == 2:
        for a, b, c, d in (y4 << 12 | x4 << 1 | p4).reshape(-1, 4).tolist():
            words = a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d
            out += struct.pack("<3I", *words)
        return bytes(out)
    for row, count in runs(y):
        out += struct.pack("<H", row << 5 | min(count, 31)) + (struct.pack("<H", count) if count >= 31 else b"")
    if packing == 1:
        for a, b, c, d in (x4 << 1 | p4).reshape(-1, 4).tolist():
            out += struct.pack("<3H", a << 4 | b & 15, b >> 4 << 8 | c & 0xFF, c >> 8 << 12 | d)
        return bytes(out)
    at, columns = 0, x.tolist() + [-1] * 6
    while at < len(x):
        first, word = columns[at], columns[at] << 5
        at += 1
        for step in range(1, 6):
            if columns[at] == first + step:
                word |= 1 << (5 - step)
                at += 1
        out += struct.pack("<H", word)
    for polarity, count in runs(p):
        out += bytes([polarity << 7 | min(count, 127)]) + (struct.pack("<H", count) if count >= 127 else b"")
    return bytes(out)


def write_metavision(path, packings):
    t, x, y, p = events()
    kind = np.dtype({"names": ["x", "y", "p", "t"], "formats": ["<u2", "<u2", "<i2", "<i8"],
                     "offsets": [0, 2, 4, 8], "itemsize": 16})
    with h5py.File(path, "w", libver="v108") as file:
        file.attrs["geometry"] = "640x480"
        file.attrs["format"] = "EVT3;height=480;width=640"
        group = file.create_group("CD")
        if packings:
            # The filter is named, and the chunks are written as it would pack them.
            properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            properties.set_chunk((CHUNK,))
            properties.set_filter(ECF, h5py.h5z.FLAG_OPTIONAL)
            space = h5py.h5s.create_simple((COUNT,), (h5py.h5s.UNLIMITED,))
            dataset = h5py.h5d.create(group.id, b"events", h5py.h5t.py_create(kind), space, properties)
            for index, begin in enumerate(range(0, COUNT, CHUNK)):
                # The last chunk is filled up with what the reader must leave out.
                part = [np.resize(v[begin : begin + CHUNK], CHUNK) for v in (x, y, p)]
                times = t[begin : begin + CHUNK]
                times = np.concatenate([times, np.repeat(times[-1], CHUNK - len(times))])
                dataset.write_direct_chunk((begin,), ecf(times, *part, packings[index % len(packings)]))
        else:
            rows = np.zeros(COUNT, kind)
            rows["t"], rows["x"], rows["y"], rows["p"] = t, x, y, p
            group.create_dataset("events", data=rows, chunks=(CHUNK,), compression="gzip")
        edge = np.dtype({"names": ["p", "t", "id"], "formats": ["<i2", "<i8", "<i2"],
                         "offsets": [0, 8, 16], "itemsize": 24})
        edges = np.array([(1, 500, 1), (0, 700, 1)], edge)
        file.create_group("EXT_TRIGGER").create_dataset("events", data=edges, chunks=(CHUNK,), maxshape=(None,))


def write(folder):
    blosc = hdf5plugin.Blosc
    write_dsec(folder / "zstd.h5", **blosc(cname="zstd", clevel=5, shuffle=blosc.SHUFFLE))
    write_dsec(folder / "zstd_bits.h5", **blosc(cname="zstd", clevel=1, shuffle=blosc.BITSHUFFLE))
    write_dsec(folder / "zstd_plain.h5", **blosc(cname="zstd", clevel=1, shuffle=blosc.NOSHUFFLE))
    write_dsec(folder / "lz4.h5", **blosc(cname="lz4", clevel=9, shuffle=blosc.SHUFFLE))
    write_dsec(folder / "stored.h5", **blosc(cname="zstd", clevel=0, shuffle=blosc.SHUFFLE))
    write_dsec(folder / "blosclz.h5", **blosc(cname="blosclz", clevel=9, shuffle=blosc.SHUFFLE))
    write_dsec(folder / "gzip.h5", compression="gzip", shuffle=True)
    write_dsec(folder / "zstd_filter.h5", **hdf5plugin.Zstd())
    write_metavision(folder / "metavision_plain.h5", [])
    write_metavision(folder / "metavision_runs.h5", [0])
    write_metavision(folder / "metavision_packed.h5", [1, 2])
    with h5py.File(folder / "other.h5", "w") as file:
        file["temperature"] = np.zeros(3)


def read(path):
    with h5py.File(path) as file:
        group = file["events"]
        found = {name: group[name][:].tolist() for name in "txyp"}
        found["types"] = {name: group[name].dtype.str for name in "txyp"}
        found["size"] = [int(group.attrs[side]) for side in ("width", "height")]
        found["t_offset"] = int(file["t_offset"][()])
        found["ms_to_idx"] = file["ms_to_idx"][:].tolist()
        json.dump(found, sys.stdout)


if __name__ == "__main__":
    {"write": write, "read": read}[sys.argv[1]](Path(sys.argv[2]))
