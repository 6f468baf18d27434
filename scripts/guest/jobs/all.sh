# The jobs independent, uvc, cameras and show one after the other, in a guest that boots once for them. What the last one recorded is
# accounted for on the host (all.after.sh). usage: run.sh all TEST-BINARY PROGRAMS (as of the jobs cameras and show)
set -euo pipefail
jobs=$(dirname "$0")
cleared() { # cleared [MODULE...]: nothing is left of the job before
  if [ $# -gt 0 ]; then modprobe -r "$@"; fi
  rm -f /run/commands /run/ledger.json
  dmesg -C
}
echo "== independent"
bash "$jobs/independent.sh"
cleared
echo "== uvc"
bash "$jobs/uvc.sh"
# The cameras of each of the next two are to be the only ones.
cleared uvcvideo vhci-hcd
echo "== cameras"
bash "$jobs/cameras.sh" "$1"
cleared vivid
echo "== show"
bash "$jobs/show.sh" "$2"
