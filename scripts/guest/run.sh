#!/usr/bin/env bash
# Boots a Debian kernel in QEMU (instruction emulation, never KVM), runs a job as root inside, and exits with the job's
# exit code. The guest sees this machine's files read-only; what it writes is lost but for its folder /kept. Where there is
# scripts/guest/jobs/JOB.after.sh, that then runs on this machine with that folder and the job's arguments, and its exit code
# counts. usage: scripts/guest/run.sh JOB [ARGUMENT...]
#   JOB             a script in scripts/guest/jobs, by name without .sh, or a path
#   GUEST_SECONDS   kill the guest after this time (default 240)
#   GUEST_MEMORY    megabytes (default 2048)
#   GUEST_CPUS      virtual processors (default 1: with instruction emulation, more are slower to boot)
#   GUEST_CLOCK     "host" (default): the guest's time is the host's, and short when the host is busy; "instructions": a
#                   nanosecond for each instruction and no time while all is idle, so that the guest's one processor is
#                   always the same speed for it, whatever the host has to do besides
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -ge 1 ] || { sed -n '2,12p' "$0" | cut -c3-; exit 2; }

job=$1; shift
[ -e "$job" ] || job=scripts/guest/jobs/$job.sh
[ -e "$job" ] || { echo "run.sh: there is no job $job" >&2; exit 2; }
job=$(realpath "$job")
for tool in qemu-system-x86_64 busybox cpio depmod python3; do
  command -v $tool >/dev/null || { echo "run.sh: $tool is missing: run scripts/setup.sh --emulation" >&2; exit 1; }
done

case ${GUEST_CLOCK:-host} in
  host) clock=(-accel tcg,thread=multi -smp "${GUEST_CPUS:-1}") ;;
  instructions) clock=(-accel tcg,thread=single -icount shift=0,sleep=off) ;;
  *) echo "run.sh: GUEST_CLOCK is host or instructions, not $GUEST_CLOCK" >&2; exit 2 ;;
esac
boot=$PWD/target/guest
scripts/guest/kernel.sh "$boot"

# The job's arguments travel in a file: a kernel's command line has no quoting.
arguments=$(mktemp -d "$boot/job.XXXXXX"); trap 'rm -rf "$arguments"' EXIT
mkdir "$arguments/kept"
printf '%q ' bash "$job" "$@" >"$arguments/job"
# A processor of few features: with all that QEMU has (max), the same takes half as long again.
set +e
timeout -s KILL "${GUEST_SECONDS:-240}" qemu-system-x86_64 \
  -M q35 -cpu Nehalem -m "${GUEST_MEMORY:-2048}" "${clock[@]}" \
  -nodefaults -no-user-config -display none -no-reboot -serial stdio \
  -kernel "$boot/vmlinux" -initrd "$boot/initrd.img" \
  -append "console=ttyS0 quiet panic=-1 no_timer_check mitigations=off erfgs_root=$PWD erfgs_job=$arguments/job" \
  -virtfs local,path=/,mount_tag=hostroot,security_model=none,readonly=on,multidevs=remap \
  -virtfs "local,path=$arguments/kept,mount_tag=kept,security_model=none" \
  -device isa-debug-exit,iobase=0xf4,iosize=4 </dev/null
code=$?
set -e
case $code in
  137) echo "run.sh: the guest was killed after ${GUEST_SECONDS:-240} s" >&2; exit 124 ;;
  # isa-debug-exit: twice the value that the guest wrote, plus one.
  0) echo "run.sh: the guest ended without saying how the job went" >&2; exit 125 ;;
  *) code=$(((code - 1) / 2)) ;;
esac
if [ $code = 0 ] && [ -e "${job%.sh}.after.sh" ]; then
  bash "${job%.sh}.after.sh" "$arguments/kept" "$@" || code=$?
fi
exit $code
