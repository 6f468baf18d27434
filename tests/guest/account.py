"""Accounts for every byte of a recorded session: what the emulated devices delivered, and what the session holds.

usage: account.py SESSION.mcap KEPT_FOLDER STREAM=DEVICE:ENDPOINT...

KEPT_FOLDER is that of `erfgs-usbd --keep`: DEVICE-SESSION-ENDPOINT.bin, one for each time that the device was plugged in.
The payloads of a stream, put together between its discontinuities, must be found in what the device delivered, in order,
each stretch contiguous; what is in no stretch is told as not recorded: it was delivered before the stream began, or while
it ended. Reads MCAP by its specification, without erfgs.
"""

import glob
import struct
import sys

HEADER = 40
DISCONTINUITY = 1


def records(data, at, end):
    while at + 9 <= end:
        kind, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
        yield kind, at + 9, at + 9 + length
        at += 9 + length


def text(data, at):
    length = struct.unpack_from("<I", data, at)[0]
    return data[at + 4 : at + 4 + length].decode(), at + 4 + length


def messages(data):
    """(channel's topic, payload) of every message, in the order of the file."""
    topics = {}
    magic = b"\x89MCAP0\r\n"
    assert data.startswith(magic) and data.endswith(magic), "the file is not whole"
    todo = [(8, len(data) - 8)]
    for start, stop in todo:
        for kind, at, end in records(data, start, stop):
            if kind == 0x06:
                _, inside = text(data, at + 28)
                length = struct.unpack_from("<Q", data, inside)[0]
                assert inside == at + 32, "chunks are compressed"
                for kind, at, end in records(data, inside + 8, inside + 8 + length):
                    if kind == 0x04:
                        topics[struct.unpack_from("<H", data, at)[0]] = text(data, at + 4)[0]
                    elif kind == 0x05:
                        yield topics[struct.unpack_from("<H", data, at)[0]], data[at + 22 : end]
            elif kind == 0x04:
                topics[struct.unpack_from("<H", data, at)[0]] = text(data, at + 4)[0]
            elif kind == 0x05:
                yield topics[struct.unpack_from("<H", data, at)[0]], data[at + 22 : end]
            elif kind == 0x0F:
                return


def stretches(packets):
    """Payloads joined between discontinuities; every packet's number must follow the one before."""
    joined, sequence = [], None
    for packet in packets:
        number, flags = struct.unpack_from("<Q", packet, 4)[0], struct.unpack_from("<I", packet, 32)[0]
        length = struct.unpack_from("<I", packet, 36)[0]
        assert len(packet) == HEADER + length, "a packet is not as long as it says"
        assert sequence is None or number == sequence + 1, f"packet {number} follows {sequence}"
        sequence = number
        if flags & DISCONTINUITY or not joined:
            joined.append(bytearray())
        joined[-1] += packet[HEADER:]
    return [bytes(stretch) for stretch in joined if stretch]


def main():
    session, kept, *pairs = sys.argv[1:]
    streams = {}
    for topic, packet in messages(open(session, "rb").read()):
        parts = topic.split("/")
        if len(parts) == 4 and parts[1] in ("event", "frame") and parts[3] != "state":
            streams.setdefault(parts[2], []).append(packet)
    wrong = 0
    for pair in pairs:
        stream, source = pair.split("=")
        device, endpoint = source.split(":")
        delivered = [open(path, "rb").read() for path in sorted(glob.glob(f"{kept}/{device}-*-{endpoint}.bin"))]
        found = stretches(streams.get(stream, []))
        at, recorded = [0] * len(delivered), 0
        for stretch in found:
            for index, data in enumerate(delivered):
                place = data.find(stretch, at[index])
                if place >= 0:
                    at[index] = place + len(stretch)
                    recorded += len(stretch)
                    break
            else:
                print(f"{stream}: a stretch of {len(stretch)} bytes is not what the device delivered")
                wrong += 1
        total = sum(map(len, delivered))
        print(f"{stream}: {len(streams.get(stream, []))} packets in {len(found)} stretches; {recorded} bytes recorded of "
              f"{total} delivered, plugged in {len(delivered)} times; {total - recorded} at the ends of stretches")
        wrong += recorded == 0
    sys.exit(1 if wrong else 0)


main()
