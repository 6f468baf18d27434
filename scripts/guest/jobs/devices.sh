# The jobs independent, uvc and cameras one after the other, in a guest that boots once for them. usage: run.sh devices
# TEST-BINARY (as of the job cameras)
set -euo pipefail
jobs=$(dirname "$0")
cleared() { # cleared: nothing is left of the job before
  rm -f /run/commands /run/ledger.json
  dmesg -C
}
for job in independent uvc; do
  echo "== $job"
  bash "$jobs/$job.sh"
  cleared
done
# Its cameras are to be the only ones.
modprobe -r uvcvideo vhci-hcd
echo "== cameras"
bash "$jobs/cameras.sh" "$1"
