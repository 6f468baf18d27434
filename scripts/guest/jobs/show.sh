# A rig of emulated devices behind the kernel's USB stack, recorded by erfgs for 10 s; one cable is pulled and plugged in
# again in the middle; then every byte is accounted for. usage: run.sh show [ERFGS]
#   ERFGS   the application, which then records; without it, the example record_seconds does
set -euo pipefail
session=/run/show/s.mcap
if [ $# -gt 0 ]; then
  record=("$1" record tests/guest/show-rig.toml --out $session --seconds 10 --no-preflight)
else
  record=(target/debug/examples/record_seconds tests/guest/show-rig.toml $session 10)
fi
modprobe vhci-hcd
modprobe uvcvideo
mkdir /run/show /run/show/kept
mkfifo /run/commands
target/debug/erfgs-usbd tests/guest/show.toml --keep /run/show/kept --ledger /run/show/ledger.json </run/commands &
daemon=$!
exec 3>/run/commands
present() { ls /sys/bus/usb/devices | grep -c '^[0-9]*-[0-9]*$'; }
for try in $(seq 300); do [ "$(present)" = 7 ] && break; sleep 0.1; done
[ "$(present)" = 7 ] || { echo "only $(present) of 7 devices are on the bus"; exit 1; }
present_cameras() { ls /dev/video* 2>/dev/null | wc -l; }
for try in $(seq 100); do [ "$(present_cameras)" -ge 8 ] && break; sleep 0.1; done

# The cameras stream meanwhile, all four at once. (uvcvideo makes a second node for each, which is no camera.)
cameras=()
for node in /dev/video*; do
  v4l2-ctl -d "$node" --list-formats | grep -q MJPG || continue
  timeout -s KILL 120 v4l2-ctl -d "$node" --set-fmt-video=width=320,height=240,pixelformat=MJPG --set-parm=15 \
    --stream-mmap=8 --stream-count=100 --stream-to="/run/show/$(basename "$node").mjpg" >"/run/show/$(basename "$node").log" 2>&1 &
  cameras+=($!)
done
[ ${#cameras[@]} = 4 ] || { echo "there are ${#cameras[@]} cameras, not 4"; exit 1; }
"${record[@]}" &
recorder=$!
# The file grows from the moment that the devices stream.
for try in $(seq 600); do [ "$(stat -c %s $session 2>/dev/null || echo 0)" -gt 100000 ] && break; sleep 0.1; done
sleep 3
echo unplug right >&3
sleep 2
echo plug right >&3
wait $recorder
for camera in "${cameras[@]}"; do wait "$camera" || { cat /run/show/*.log; exit 1; }; done
echo quit >&3
wait $daemon
python3 tests/guest/account.py $session /run/show/kept left=left:81 right=right:81 davis=davis:82
python3 - /run/show/*.mjpg <<'P'
import re, sys
for path in sys.argv[1:]:
    numbers = [int(n) for n in re.findall(rb'\xff\xd8\xff\xfe..erfgs frame (\d+) ', open(path, 'rb').read(), re.S)]
    gaps = sum(b - a - 1 for a, b in zip(numbers, numbers[1:]))
    print(path, len(numbers), 'frames,', gaps, 'missing between them')
    assert len(numbers) == 100 and numbers == sorted(set(numbers)), numbers
P
