"""Accounts for every byte of a recorded session: what the emulated devices delivered, and what the session holds.

usage: account.py FOLDER STREAM=DEVICE:ENDPOINT...

FOLDER holds s.mcap; s.sync.json (`erfgs sync`); kept, the folder of `erfgs-usbd --keep` with DEVICE-SESSION-ENDPOINT.bin,
one for each time that the device was plugged in; ledger.json (`erfgs-usbd --ledger`); and edges, the log of the simulated
trigger board. Reads MCAP by its specification, without erfgs.

- Events: the payloads of a stream, put together between its discontinuities, are found in what the device delivered, in
  order, each stretch contiguous, one for each time that it was plugged in. What is in no stretch, a fifth of it at most, was
  delivered before the stream began, or while it ended.
- Frames: every frame of the session is one that the camera delivered, byte for byte, once and in order. Where the kernel's
  count of frames has gaps, as many frames are missing, the driver has counted them as lost, and no others are missing
  but at the ends of stretches. What the camera exposed and did not deliver, it has counted as lost itself.
- Pulses: the lines of the board tell every pulse that left its pins, in order. Every frame was exposed by a pulse, and
  `erfgs sync` finds that pulse; the event cameras saw every pulse while they were plugged in.
- Clocks: an event camera has an epoch for each time that it was plugged in, and in each of them its edges, read from the
  words here, are at the times of the board's pulses, one after the other.
"""

import binascii
import bisect
import glob
import json
import re
import struct
import sys

HEADER = 40
DISCONTINUITY = 1
DAMAGED = 2
CYCLE_NS = 62.5

wrong = []


def check(condition, complaint):
    if not condition:
        wrong.append(complaint)
        print("WRONG:", complaint)


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
    for kind, at, end in records(data, 8, len(data) - 8):
        if kind == 0x0F:  # the end of the data
            return
        if kind != 0x06:  # a chunk
            continue
        _, inside = text(data, at + 28)
        assert inside == at + 32, "chunks are compressed"
        length = struct.unpack_from("<Q", data, inside)[0]
        for kind, at, end in records(data, inside + 8, inside + 8 + length):
            number = struct.unpack_from("<H", data, at)[0]
            if kind == 0x04:
                topics[number] = text(data, at + 4)[0]
            elif kind == 0x05:
                yield topics[number], data[at + 22 : end]


def session_start(data):
    """The host time of the session's zero, from its metadata."""
    for kind, at, end in records(data, 8, len(data) - 8):
        if kind == 0x0C and text(data, at)[0] == "erfgs.session":
            _, at = text(data, at)
            pairs, at = at + 4 + struct.unpack_from("<I", data, at)[0], at + 4
            while at < pairs:
                key, at = text(data, at)
                value, at = text(data, at)
                if key == "host_ns":
                    return int(value)
    raise ValueError("the file does not say when the session began")


class Packet:
    def __init__(self, message):
        self.sequence, self.host_ns, self.kernel_ns = struct.unpack_from("<Qqq", message, 4)
        self.kernel_sequence, flags, length = struct.unpack_from("<III", message, 28)
        self.discontinuity, self.damaged = bool(flags & DISCONTINUITY), bool(flags & DAMAGED)
        self.payload = message[HEADER:]
        assert len(self.payload) == length, "a packet is not as long as it says"


def stretches(name, packets):
    """Packets between discontinuities. Every packet's number must follow the one before: none was dropped."""
    runs, expected = [], 0
    for packet in packets:
        check(packet.sequence == expected, f"{name}: packet {packet.sequence} comes where {expected} is due")
        expected = packet.sequence + 1
        if packet.discontinuity or not runs:
            runs.append([])
        runs[-1].append(packet)
    return runs


def delivered(folder, source):
    device, endpoint = source.split(":")
    return [open(path, "rb").read() for path in sorted(glob.glob(f"{folder}/kept/{device}-*-{endpoint}.bin"))]


def account_events(name, packets, sent):
    runs = [b"".join(packet.payload for packet in run) for run in stretches(name, packets)]
    check(len(runs) == len(sent), f"{name}: {len(runs)} stretches, plugged in {len(sent)} times")
    at, recorded = [0] * len(sent), [0] * len(sent)
    for run in runs:
        for index, data in enumerate(sent):
            place = data.find(run, at[index])
            if place >= 0:
                at[index] = place + len(run)
                recorded[index] += len(run)
                break
        else:
            check(False, f"{name}: a stretch of {len(run)} bytes is not what the device delivered")
    ends = [len(data) - held for data, held in zip(sent, recorded)]
    print(f"{name}: {len(packets)} packets in {len(runs)} stretches; {sum(recorded)} bytes recorded of {sum(map(len, sent))} "
          f"delivered, plugged in {len(sent)} times; at the ends of stretches {ends}")
    for index, (data, held) in enumerate(zip(sent, recorded)):
        check(held > 0.8 * len(data), f"{name}: plugged in for the {index + 1}. time, {held} of {len(data)} bytes recorded")


def frames_of(name, data):
    """Takes payloads of the USB Video Class apart: a header of 12 bytes each; bit 1 of its flags ends a frame."""
    frames, at, frame = [], 0, b""
    while at < len(data):
        assert data[at] == 12, f"{name}: no payload header at byte {at}"
        if data[at + 1] & 2:
            # The rest of a JPEG image, which ends at its only end marker.
            end = data.find(b"\xff\xd9", at + 12)
            if end < 0:
                break
            frames.append(frame + data[at + 12 : end + 2])
            at, frame = end + 2, b""
        else:
            frame += data[at + 12 : at + 16384]
            at += 16384
    return frames


def truth(frame):
    """A frame's number and the true start of its exposure, as the emulated camera wrote them into its comment."""
    number, start = re.match(rb"\xff\xd8\xff\xfe..erfgs frame (\d+) (\d+) ", frame, re.S).groups()
    return int(number), int(start)


def account_frames(name, packets, sent, status, counts):
    sent = [frames_of(name, data) for data in sent]
    place = {frame: (session, index) for session, frames in enumerate(sent) for index, frame in enumerate(frames)}
    check(len(place) == sum(map(len, sent)), f"{name}: two delivered frames are the same")
    runs, missing = stretches(name, packets), 0
    for run in runs:
        before = None
        for packet in run:
            here = place.get(packet.payload)
            if here is None:
                check(False, f"{name}: frame {packet.sequence} is not one that the camera delivered")
                continue
            if before is not None:
                (session, index), kernel = before
                gap = here[1] - index
                check(here[0] == session and gap > 0, f"{name}: frame {packet.sequence} is out of order")
                check(gap == packet.kernel_sequence - kernel, f"{name}: the kernel counts other gaps than there are")
                missing += gap - 1
            before = (here, packet.kernel_sequence)
    total = len(place)
    lost = status["streams"][name]["counters"]["lost"]
    check(missing <= lost, f"{name}: {missing} frames are missing, and {lost} are counted as lost")
    check(counts["seen"] == counts["lost"] + counts["frames"], f"{name}: the camera's own counts do not add up")
    ends = total - len(packets) - missing
    unread = counts["frames"] - total
    print(f"{name}: {len(packets)} frames in {len(runs)} stretches of {total} delivered; {missing} missing between them, "
          f"{ends} at the ends; {counts['seen']} exposed, {counts['lost']} lost in the camera, {unread} left there")
    # The kernel's buffers when a stream is stopped or a cable pulled; the camera's own, likewise.
    check(0 <= ends <= 8 * len(runs) and 0 <= unread <= 2 * len(runs), f"{name}: too many frames are not accounted for")
    check(len(packets) > 0, f"{name}: nothing was recorded")


def board_lines(packets):
    """Bodies of the board's lines, their checksums checked. The first may be half a line."""
    bodies = []
    for number, packet in enumerate(packets):
        body, _, told = packet.payload.rstrip(b"\n").partition(b"*")
        whole = told == b"%04x" % binascii.crc_hqx(body, 0)
        check(whole or not body or number == 0, f"trigger: line {packet.payload!r} is damaged")
        if whole and body:
            bodies.append(body.decode())
    return bodies


def rises(folder):
    """Cycles at which the event cameras' output (bit 0 of port B) rose."""
    found, level = [], 0
    for line in open(f"{folder}/edges"):
        cycle, port, value = line.split()
        if port == "B":
            now = int(value, 16) & 1
            if now > level:
                found.append(int(cycle))
            level = now
    return found


def edges_of_evt3(data):
    """(place of the word, time in 24 bits of microseconds) of every rising edge in words of EVT 3."""
    kinds = data[1::2]
    highs, lows = ([found.start() for found in re.finditer(kind, kinds)] for kind in (rb"[\x80-\x8f]", rb"[\x60-\x6f]"))
    word = lambda place: data[2 * place] | data[2 * place + 1] << 8
    for found in re.finditer(rb"[\xa0-\xaf]", kinds):
        at = found.start()
        high, low = bisect.bisect(highs, at) - 1, bisect.bisect(lows, at) - 1
        if high >= 0 and word(at) & 1:
            # A high time word begins with a low time of 0.
            fresh = low < 0 or lows[low] < highs[high]
            yield at, (word(highs[high]) & 0xFFF) << 12 | (0 if fresh else word(lows[low]) & 0xFFF)


def edges_of_davis(data):
    """(place of the word, microseconds since the clock was reset) of every rising edge in words of a DAVIS."""
    kinds, base, time = data[1::2], 0, 0
    for found in re.finditer(rb"[\x80-\xff\x70-\x7f\x00]", kinds):
        at = found.start()
        word = data[2 * at] | data[2 * at + 1] << 8
        if word >> 15:
            time = base + (word & 0x7FFF)
        elif word >> 12 == 7:
            base += (word & 0xFFF) << 15
        elif word == 1:
            base = 0
        elif word == 3:
            yield at, time


def session_ns(clock, ticks):
    pieces = clock["pieces"]
    piece = next((piece for piece in pieces if ticks <= piece["window_ticks"][1]), pieces[-1])
    return piece["origin_ns"] + (ticks - piece["origin_ticks"]) * piece["ns_per_tick"]


def account_clocks(name, packets, epochs, rises_ns, start_ns, davis):
    """Every edge is where a pulse was, and edges that follow each other are pulses that do."""
    for run in stretches(name, packets):
        data, ends, total = b"".join(packet.payload for packet in run), [], 0
        for packet in run:
            total += len(packet.payload)
            ends.append(total)
        off, indices = [], []
        for at, time in (edges_of_davis if davis else edges_of_evt3)(data):
            packet = run[bisect.bisect_left(ends, 2 * at + 2)]
            clock = [epoch for epoch in epochs if epoch["first_sequence"] <= packet.sequence][-1]["clock"]
            here, arrived = session_ns(clock, time), packet.host_ns - start_ns
            if not davis:
                # Ticks count the roll-overs since the stream began. The device's own time has 24 bits.
                loops = round((arrived - here) / (1 << 24) / 1000)
                here = session_ns(clock, time + (loops << 24))
            check(-20e6 < arrived - here < 2e9, f"{name}: an edge that came at {arrived} is dated {here}")
            near = bisect.bisect(rises_ns, here)
            index = min((i for i in (near - 1, near) if 0 <= i < len(rises_ns)), key=lambda i: abs(rises_ns[i] - here))
            indices.append(index)
            off.append(abs(rises_ns[index] - here))
        check(len(off) > 20, f"{name}: {len(off)} edges in a stretch are too few to tell")
        check(indices == list(range(indices[0], indices[0] + len(indices))), f"{name}: its edges are not one pulse each")
        off.sort()
        p95, worst = off[len(off) * 95 // 100] / 1e3, off[-1] / 1e3
        print(f"{name}: {len(off)} edges from packet {run[0].sequence} on are pulses {indices[0]} to {indices[-1]}, "
              f"95 % of them within {p95:.1f} µs and all within {worst:.1f} µs")
        check(p95 < 2 and worst < 10, f"{name}: its clock is off")


def account_pulses(folder, packets, streams, sync, plugged, start_ns):
    bodies = board_lines(packets)
    told = [body.split() for body in bodies if body.startswith("p ")]
    given = rises(folder)
    check([int(pulse[1], 16) for pulse in told] == list(range(len(told))), "trigger: pulses are missing in the lines")
    offsets = {cycle - int(pulse[2], 16) for cycle, pulse in zip(given, told)}
    check(len(told) == len(given) and len(offsets) == 1, f"trigger: {len(told)} pulses told, {len(given)} given")
    stops = [int(body.split()[1], 16) for body in bodies if body.startswith("+stop ")]
    check(stops[-1:] == [len(told)], f"trigger: the board counted {stops[-1:]} pulses")
    print(f"trigger: {len(packets)} lines; {len(told)} pulses told and given, each at the cycle that was told")
    check(len(told) > 100, "trigger: too few pulses")

    by_id = {stream["id"]: stream for stream in sync["streams"]}
    of_board = by_id["trigger"]["epochs"][0]["clock"]
    rises_ns = [session_ns(of_board, int(pulse[2], 16)) for pulse in told]
    for name, kind, packets in streams:
        found = by_id[name]
        check(found["tier"] == "hardware-triggered", f"{name}: its pulses were not recognised")
        if kind == "event":
            matched = found["matched"]
            print(f"{name}: {matched}")
            check(matched["unreadable"] == 0, f"{name}: pulses are unreadable")
            check(matched["matched"] == matched["seen"], f"{name}: pulses were not recognised")
            # The last pulses may be what a sensor still held back when it was stopped.
            check(matched["breaks"] == 0, f"{name}: the train of pulses has breaks")
            check(len(found["epochs"]) == plugged[name], f"{name}: it has {len(found['epochs'])} epochs")
            account_clocks(name, packets, found["epochs"], rises_ns, start_ns, name == "davis")
            check(plugged[name] > 1 or matched["given"] - matched["matched"] < 15, f"{name}: pulses were not seen")
        else:
            exposures = found["exposures"]
            numbered = dict(zip(exposures["sequence"], exposures["pulse"]))
            # One offset ties the board's cycles to the times that the cameras were told.
            by_start = {}
            starts = {packet.sequence: truth(packet.payload)[1] for packet in packets}
            zero = min(starts.values()) - given[numbered[min(numbered)]] * CYCLE_NS
            pulse_at = {round(zero + cycle * CYCLE_NS): index for index, cycle in enumerate(given)}
            for sequence, start in starts.items():
                near = [pulse_at[at] for at in range(start - 2, start + 3) if at in pulse_at]
                check(len(near) == 1, f"{name}: frame {sequence} was exposed by no pulse")
                by_start[sequence] = near and near[0]
            astray = sum(numbered.get(sequence) != pulse for sequence, pulse in by_start.items())
            print(f"{name}: {len(starts)} frames, each exposed by a pulse of its own; sync tells another pulse for {astray}")
            check(len(set(by_start.values())) == len(by_start), f"{name}: a pulse exposed two frames")
            check(astray == 0, f"{name}: sync tells other pulses")


def main():
    folder, *pairs = sys.argv[1:]
    streams, status = {}, None
    data = open(f"{folder}/s.mcap", "rb").read()
    start_ns = session_start(data)
    for topic, message in messages(data):
        parts = topic.split("/")
        if topic == "/status":
            status = json.loads(message)
        elif len(parts) == 4 and parts[1] in ("event", "frame", "trigger") and parts[3] != "state":
            streams.setdefault((parts[2], parts[1]), []).append(Packet(message))
    ledger = json.load(open(f"{folder}/ledger.json"))
    sync = json.load(open(f"{folder}/s.sync.json"))
    sources = dict(pair.split("=") for pair in pairs)
    of_cameras = [(name, kind, packets) for (name, kind), packets in streams.items() if kind != "trigger"]
    check({name for name, _, _ in of_cameras} == set(sources), "the session has other streams")
    plugged = {}
    for name, kind, packets in of_cameras:
        sent = delivered(folder, sources[name])
        plugged[name] = len(sent)
        if kind == "event":
            account_events(name, packets, sent)
        else:
            account_frames(name, packets, sent, status, ledger[sources[name].split(":")[0]]["counts"])
        dropped = status["streams"][name]["dropped"]
        check(not any(dropped.values()), f"{name}: the recorder dropped {dropped}")
    account_pulses(folder, streams[("trigger", "trigger")], of_cameras, sync, plugged, start_ns)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
