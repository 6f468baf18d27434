#!/bin/bash
# Runs the job in the guest, and tells QEMU its exit code.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8
mount -t tmpfs run /run
mkdir -p /dev/pts /dev/shm
mount -t devpts devpts /dev/pts
mount -t tmpfs shm /dev/shm
mkdir /kept
mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 kept /kept
mount -t configfs none /sys/kernel/config 2>/dev/null
ip link set lo up 2>/dev/null || busybox ifconfig lo 127.0.0.1 up
for word in $(cat /proc/cmdline); do
  case $word in
    erfgs_root=*) cd "${word#erfgs_root=}" ;;
    erfgs_job=*) job=${word#erfgs_job=} ;;
  esac
done
bash "$job"
code=$?
echo "guest: the job ended with $code after $(cut -d' ' -f1 /proc/uptime) s"
sync
# The device exits QEMU with twice this plus one.
printf "\\x$(printf %x $code)" | dd of=/dev/port bs=1 seek=244 status=none
sleep 5
