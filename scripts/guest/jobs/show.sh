# A whole rig behind the kernel's USB stack, recorded by the application for 10 s: two EVK4, a DAVIS346, four cameras and
# the trigger board that drives them all. Two cables are pulled and plugged in again in the middle. What was recorded, and what
# the devices delivered, is accounted for on the host (show.after.sh). usage: run.sh show [PROGRAMS]
#   PROGRAMS   the folder of erfgs and erfgs-usbd (default target/debug; scripts/emulation.sh builds all that runs here)
set -euo pipefail
. scripts/guest/wait.sh
programs=${1:-target/debug}
board=target/trigger-board
show=/run/show
session=$show/s.mcap
mkdir $show $show/kept $show/bin
# From memory, so that nothing waits for files of the host while the rig runs.
cp $programs/erfgs $programs/erfgs-usbd $board/board $board/firmware.elf $show/bin
ldd $show/bin/erfgs $show/bin/erfgs-usbd $show/bin/board | grep -o '/[^ ]*' | grep -v : | xargs cat >/dev/null
mkfifo $show/commands $show/button
for module in vhci-hcd uvcvideo dummy_hcd libcomposite usb_f_acm cdc-acm; do modprobe $module; done

since() { echo "show: $1 after $(cut -d' ' -f1 /proc/uptime) s"; }

# The cameras, on a virtual host controller.
$show/bin/erfgs-usbd tests/guest/show.toml --keep $show/kept --ledger $show/ledger.json <$show/commands &
daemon=$!
exec 3>$show/commands
wait_for "bus with 7 devices" on_the_bus 7

# The board: its firmware runs in simavr, whose serial line is a USB serial port of another virtual controller (an Arduino
# Uno's, by its numbers). It tells every edge of its trigger output to the cameras.
gadget=/sys/kernel/config/usb_gadget/board
mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
mkdir -p $gadget/strings/0x409 $gadget/configs/c.1 $gadget/functions/acm.board
echo 0x2341 >$gadget/idVendor
echo 0x0043 >$gadget/idProduct
echo 75330303035351F0 >$gadget/strings/0x409/serialnumber
ln -s $gadget/functions/acm.board $gadget/configs/c.1
ls /sys/class/udc >$gadget/UDC
wait_for "serial port" test -e /dev/ttyGS0
$show/bin/board $show/bin/firmware.elf /dev/ttyGS0 $show/edges $show/commands <$show/button &
simulator=$!
exec 4>$show/button
wait_for "serial port of the board" test -e /dev/ttyACM0
# uvcvideo makes two nodes for each camera.
nodes() {
  local nodes=(/dev/video*)
  [ ${#nodes[@]} = 8 ]
}
wait_for "four cameras" nodes
since "all devices are there"

processor() { awk '/^cpu / {print $2 + $3 + $4 + $6 + $7 + $8, $5}' /proc/stat; } # busy and idle time
before=$(processor)
# The disk is memory here, whose speed says nothing.
$show/bin/erfgs record tests/guest/show-rig.toml --out $session --seconds 10 --disk-test 0 2>$show/log &
recorder=$!
trap 'cat $show/log' EXIT
# Pulses are the last to start.
pulses() {
  kill -0 $recorder 2>/dev/null || exit 1
  local edges without
  read -rd '' edges <$show/edges || true
  without=${edges//B/}
  [ $((${#edges} - ${#without})) -gt 40 ]
}
wait_for pulses pulses
since "the rig runs"
sleep 1
echo unplug right >&3
echo unplug cam1 >&3
sleep 1.5
echo plug right >&3
echo plug cam1 >&3
wait $recorder
since "the recording is over"
echo "$before $(processor)" | awk '{busy = $3 - $1; print "show: the processor was busy for", int(100 * busy / (busy + $4 - $2)), "% of it"}'
exec 4>&-
wait $simulator
echo quit >&3
wait $daemon
cp -r $session $show/kept $show/ledger.json $show/edges /kept
! dmesg -l err,warn | grep -iE 'vhci.*cannot find|uvcvideo.*(Failed|Non-zero)'
