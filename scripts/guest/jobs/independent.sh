# The published drivers open the emulated EVK4 and DAVIS346 through the kernel's USB stack and decode what is known.
set -euo pipefail
. scripts/guest/wait.sh
modprobe vhci-hcd
mkfifo /run/commands
target/debug/erfgs-usbd tests/guest/cameras.toml --ledger /run/ledger.json </run/commands &
daemon=$!
exec 3>/run/commands
wait_for "bus with 2 devices" on_the_bus 2
grep -H . /sys/bus/usb/devices/*-*/{product,speed}
code=0
target/independent/release/independent evk4 00051234 100000 1 || code=1
target/independent/release/independent davis346 00000336 50000 1 || code=1
echo quit >&3
wait $daemon || code=1
grep -A8 '"counts"' /run/ledger.json
dmesg -l err,warn | grep -iE 'usb|vhci' && code=1
exit $code
