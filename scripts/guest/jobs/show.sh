# A rig of emulated devices behind the kernel's USB stack, recorded by erfgs for 10 s; one cable is pulled and plugged in
# again in the middle; then every byte is accounted for. usage: run.sh show [ERFGS]   (default: target/debug/erfgs)
set -euo pipefail
erfgs=${1:-target/debug/erfgs}
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
"$erfgs" devices || true

"$erfgs" record tests/guest/show-rig.toml --out /run/show/s.mcap --seconds 10 --no-preflight &
recorder=$!
# The file grows from the moment that the devices stream.
for try in $(seq 600); do [ "$(stat -c %s /run/show/s.mcap 2>/dev/null || echo 0)" -gt 100000 ] && break; sleep 0.1; done
sleep 3
echo unplug right >&3
sleep 2
echo plug right >&3
wait $recorder
echo quit >&3
wait $daemon
"$erfgs" info /run/show/s.mcap
python3 tests/guest/account.py /run/show/s.mcap /run/show/kept left=left:81 right=right:81 davis=davis:82
