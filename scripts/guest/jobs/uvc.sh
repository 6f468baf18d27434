# The kernel's own camera driver binds to an emulated camera, lists what it offers, sets its controls and receives its
# frames; a pulled cable takes the camera away, and it comes back.
set -euo pipefail
. scripts/guest/wait.sh
modprobe vhci-hcd
modprobe uvcvideo
mkfifo /run/commands
target/debug/erfgs-usbd tests/guest/uvc.toml --ledger /run/ledger.json </run/commands &
daemon=$!
exec 3>/run/commands
wait_for /dev/video0 test -e /dev/video0
v4l2-ctl -d /dev/video0 --list-formats | grep "'" | tee /run/formats
[ "$(grep -oE "'(MJPG|YUYV|NV12|GREY)'" /run/formats | sort -u | wc -l)" = 4 ]

v4l2-ctl -d /dev/video0 --set-ctrl auto_exposure=1 --set-ctrl exposure_time_absolute=40 --set-ctrl gain=99 \
  --set-ctrl white_balance_automatic=0 --set-ctrl white_balance_temperature=5000
v4l2-ctl -d /dev/video0 --get-ctrl exposure_time_absolute,gain,white_balance_temperature | sort | tee /run/controls
printf 'exposure_time_absolute: 40\ngain: 99\nwhite_balance_temperature: 5000\n' | cmp - /run/controls

# Each format: frames of the right size, whose numbers follow each other.
for format in MJPG YUYV NV12 GREY; do
  timeout -s KILL 60 v4l2-ctl -d /dev/video0 --set-fmt-video=width=320,height=240,pixelformat=$format --stream-mmap=4 \
    --stream-count=30 --stream-to=/run/frames >/run/log 2>&1 || { cat /run/log; exit 1; }
  python3 - $format <<'P'
import re, struct, sys
data = open('/run/frames', 'rb').read()
if sys.argv[1] == 'MJPG':
    numbers = [int(n) for n in re.findall(rb'\xff\xd8\xff\xfe..erfgs frame (\d+) ', data, re.S)]
else:
    step, size = {'YUYV': (2, 320 * 240 * 2), 'NV12': (1, 320 * 240 * 3 // 2), 'GREY': (1, 320 * 240)}[sys.argv[1]]
    assert len(data) == 30 * size, len(data)
    numbers = [struct.unpack('<Q', data[at:at + 8 * step:step])[0] for at in range(0, len(data), size)]
gaps = sum(b - a - 1 for a, b in zip(numbers, numbers[1:]))
print(sys.argv[1], len(numbers), 'frames,', gaps, 'missing between them')
assert len(numbers) == 30 and gaps <= 6 and numbers == sorted(set(numbers)), numbers
P
done

# A pulled cable, in the middle of a stream.
timeout -s KILL 60 v4l2-ctl -d /dev/video0 --stream-mmap=4 --stream-count=300 --stream-to=/dev/null >/run/log 2>&1 &
stream=$!
# It draws a mark for each frame, and starts as slowly as this machine is.
for try in {1..240}; do grep -q '<<' /run/log && break; rest 0.25; done
echo unplug camera >&3
# v4l2-ctl ends well whatever the error was; what it printed tells.
wait $stream || true
grep -o 'VIDIOC_DQBUF: failed.*' /run/log || { echo "the stream did not end with the camera"; cat /run/log; exit 1; }
[ ! -e /dev/video0 ]
echo plug camera >&3
wait_for /dev/video0 test -e /dev/video0
timeout -s KILL 60 v4l2-ctl -d /dev/video0 --stream-mmap=4 --stream-count=10 --stream-to=/dev/null >/run/log 2>&1
echo quit >&3
wait $daemon
cat /run/ledger.json
! dmesg -l err,warn | grep -E 'vhci.*cannot find|uvcvideo.*(Failed|Non-zero)'
