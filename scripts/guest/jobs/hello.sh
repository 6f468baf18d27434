# The guest works: it has a USB host controller, and says so.
set -euo pipefail
modprobe vhci-hcd
modprobe uvcvideo
cat /sys/devices/platform/vhci_hcd.0/status | head -3
uname -r
