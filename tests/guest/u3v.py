"""Accounts for every frame of a session of a USB3 Vision camera: what the emulated camera sent, and what the session holds.

usage: u3v.py FOLDER

FOLDER holds take.mcap, which `erfgs record` wrote of u3v-rig.toml; pictures, which `erfgs export` made of it; kept, the folder of
`erfgs-usbd --keep`, with mono-0-82.bin; and ledger.json (`erfgs-usbd --ledger`). Blocks are taken apart by the protocol, without erfgs. u3v.toml says what the camera loses.

- A block that came whole is a frame of the session, byte for byte, with the camera's time; one that did not is a frame that is marked as
  damaged and begins with what came of it.
- Blocks of which nothing came, or no leader, are counted as lost, each once. No others are missing but at the end.
- What the camera exposed it sent, or counts as lost itself.
- There is a picture of every frame of the session.
"""

import glob
import json
import struct
import sys

from account import Packet, check, messages, wrong

IMAGE = 160 * 120


class Block:
    """What came of a block: its leader's fields, its payload as far as it came, and its trailer's fields, if that came."""

    def __init__(self, stream, at, end):
        leader_bytes = struct.unpack_from("<H", stream, at + 6)[0]
        self.id, self.time_ns = struct.unpack_from("<Q", stream, at + 8)[0], struct.unpack_from("<Q", stream, at + 20)[0]
        trailer = stream.find(b"U3VT\0\0", at + leader_bytes, end)
        while trailer >= 0 and struct.unpack_from("<Q", stream, trailer + 8)[0] != self.id:
            trailer = stream.find(b"U3VT\0\0", trailer + 1, end)
        self.payload = stream[at + leader_bytes : trailer if trailer >= 0 else end]
        self.has_trailer = trailer >= 0
        status, valid = struct.unpack_from("<H2xQ", stream, trailer + 16) if self.has_trailer else (0, 0)
        self.is_whole = self.has_trailer and status == 0 and valid == len(self.payload)


def blocks(stream):
    """The blocks that have a leader. Of one without, the rest is behind the block before, whose trailer ends that."""
    starts, at = [], stream.find(b"U3VL\0\0\x34\0")
    while at >= 0:
        starts.append(at)
        at = stream.find(b"U3VL\0\0\x34\0", at + 1)
    return [Block(stream, at, end) for at, end in zip(starts, starts[1:] + [len(stream)])]


def account_for(packets, sent):
    """Every frame is what came of its block, in the order in which they came."""
    by_id = {block.id: block for block in sent}
    check(len(by_id) == len(sent), "two blocks have one id")
    whole = 0
    for number, packet in enumerate(packets):
        block = by_id.get(packet.kernel_sequence)
        check(packet.sequence == number, f"packet {packet.sequence} comes where {number} is due")
        check(block is not None, f"frame {packet.kernel_sequence} is not one that the camera sent")
        if block is None:
            continue
        came = block.payload[:IMAGE]
        check(packet.payload == came + bytes(IMAGE - len(came)), f"frame {block.id} is not what the camera sent")
        check(packet.damaged != block.is_whole, f"frame {block.id}: damaged {packet.damaged}, whole {block.is_whole}")
        check(packet.kernel_ns == block.time_ns, f"frame {block.id} has another time than the camera's")
        whole += block.is_whole
    return whole


def main():
    folder = sys.argv[1]
    packets, status = [], None
    for topic, message in messages(open(f"{folder}/take.mcap", "rb").read()):
        if topic == "/status":
            status = json.loads(message)["streams"]["mono"]
        elif topic == "/frame/mono/grey8":
            packets.append(Packet(message))
    sent = blocks(open(f"{folder}/kept/mono-0-82.bin", "rb").read())
    whole = account_for(packets, sent)
    ids = [packet.kernel_sequence for packet in packets]
    newest = ids[-1]
    check(ids == [block.id for block in sent if block.id <= newest], "frames are missing, or out of order")
    after = sum(block.id > newest for block in sent)
    check(after <= 4, f"{after} blocks came after the last frame of the session")
    lost = newest + 1 - len(ids)
    counted = status["counters"]
    check(counted["lost"] == lost == 3, f"{lost} frames have no block, and {counted['lost']} are counted as lost")
    check(counted["errors"] == len(ids) - whole == 4, f"{len(ids) - whole} frames are damaged, and {counted['errors']} counted")
    check(not any(status["dropped"].values()), f"the recorder dropped {status['dropped']}")
    camera = json.load(open(f"{folder}/ledger.json"))["mono"]["counts"]
    check(camera["lost"] == 0 and camera["frames"] == camera["seen"] > newest, f"the camera counts {camera}")
    pictures = len(glob.glob(f"{folder}/pictures/mono/*.png"))
    check(pictures == len(ids), f"{pictures} pictures of {len(ids)} frames")
    print(f"mono: {len(ids)} frames of {len(sent)} blocks, {whole} of them whole and byte for byte what the camera sent; {lost} lost, "
          f"{len(ids) - whole} damaged")
    check(whole > 50, "too few frames")
    sys.exit(1 if wrong else 0)


main()
